"""A frame that is asked about again when others have followed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depthprint.cascade.verified_recognizer import RECONSIDERED, VerifiedRecognizer
from depthprint.errors import SettingsError
from depthprint.verification import GeometricVerifier, make_depth_view
from depthprint.verification.hypotheses import Hypothesis, seconded_from_behind
from depthprint.verification.temporal_evidence import TemporalEvidence
from place_doubles import Told
from test_depth_odometry import STEP_M, frame, true_pose


def described(recognizer: VerifiedRecognizer, x: float, needed: float, seconded: float = 0.2):
    found = recognizer.describe(frame(x))
    settings = replace(
        found.view.settings,
        min_overlap=needed,
        min_overlap_seconded=seconded,
        min_overlap_motion=0.2,
        witness_m=STEP_M,
        offset_weight=1.0,
    )
    return replace(found, view=replace(found.view, settings=settings))


def drive_back(track: bool) -> tuple[VerifiedRecognizer, int]:
    """Places 0 to 3, then back: frame 4 returns to place 2, which asks for too much, frames 5 and 6 to 1 and 0."""
    inner = Told(distance=0.2)
    recognizer = VerifiedRecognizer(inner, k=1, spread=1, climb=False, track=track)
    for i in range(4):
        recognizer.add(described(recognizer, STEP_M * i, 1.0 if i == 2 else 0.3))
    for place, x in ((2, 2.2), (1, 1.1), (0, 0.1)):
        inner.place = place
        query = described(recognizer, STEP_M * x, 0.3)
        found = recognizer.query(query, limit=3)[0]
        assert (found.place, found.verification.accepted) == (place, place != 2)
        recognizer.add(query)
    return recognizer, 4


@pytest.mark.parametrize("track", [True, False])
def test_weak_match_is_accepted_once_matches_after_it_lead_back_to_it(track):
    recognizer, number = drive_back(track)
    found = next(match for match in recognizer.reconsider(number, k=9) if match.place == 2)
    assert found.verification.accepted == track
    assert (found.distance < 1.0) == track
    if track:
        np.testing.assert_allclose(
            found.verification.T_match_query, true_pose(2 * STEP_M, 2.2 * STEP_M), atol=0.1
        )
    # Asking changes nothing.
    again = recognizer.reconsider(number, k=9)
    assert [(m.place, m.distance) for m in again] == [
        (m.place, m.distance) for m in recognizer.reconsider(number, k=9)
    ]


def test_a_place_that_nobody_proposed_is_found_by_the_match_after_it():
    inner = Told(place=1, distance=0.2)
    recognizer = VerifiedRecognizer(inner, k=1, spread=1, climb=False, track=True)
    recognizer.add(described(recognizer, 0.0, 0.3))
    recognizer.add(described(recognizer, STEP_M, 1.0, seconded=1.0))
    stray = described(recognizer, STEP_M * 0.6, 0.3)
    checked = [m for m in recognizer.query(stray, k=9) if m.verification is not None]
    assert [(m.place, m.verification.accepted) for m in checked] == [(1, False)]
    number = recognizer.add(stray)
    inner.place = 0
    after = described(recognizer, STEP_M * 0.2, 0.3)
    assert recognizer.query(after, limit=2)[0].verification.accepted
    recognizer.add(after)
    found = next(m for m in recognizer.reconsider(number, k=9) if m.place == 0)
    assert found.verification.accepted
    assert found.verification.offset_m == pytest.approx(0.6 * STEP_M, abs=0.1)


def test_only_the_last_frames_that_were_queried_can_be_asked_about_again():
    recognizer, number = drive_back(track=True)
    with pytest.raises(SettingsError, match=f"one of the last {RECONSIDERED} frames.*got frame 3"):
        recognizer.reconsider(3)
    here = described(recognizer, 0.0, 0.3)
    for _ in range(RECONSIDERED):
        recognizer.add(here)
    with pytest.raises(SettingsError, match=f"got frame {number}"):
        recognizer.reconsider(number)


def test_what_later_frames_say_has_nothing_of_the_frame_itself():
    """A later match that only an earlier one supports does not hand that one's evidence back to it."""
    evidence = TemporalEvidence(GeometricVerifier())
    views = [make_depth_view(frame(STEP_M * i)) for i in range(4)]
    views = [replace(view, settings=replace(view.settings, witness_m=STEP_M)) for view in views]
    for view in views[:2]:
        evidence.add(view)
    first, second = (Hypothesis(0, true_pose(0.0, STEP_M * i), 0.8, 0.0, True, alone=0.8) for i in (2, 3))
    evidence.add(views[2], [first])
    for alone, supports in ((0.0, False), (0.6, True)):
        echo = TemporalEvidence(GeometricVerifier())
        for view in views[:2]:
            echo.add(view)
        echo.add(views[2], [first])
        echo.add(views[3], [replace(second, strength=0.7, support=0.7, alone=alone)])
        said = echo.of(2, views[2]).said(0, first.T_match_query).support
        assert (said > 0.1) == supports
        hypotheses = echo.of(2, views[2]).after
        assert [h.support for h in hypotheses[3]] == [0.0]
        assert hypotheses[3][0].strength == pytest.approx(alone)


def test_support_is_handed_on_from_the_last_frame_to_the_first():
    evidence = TemporalEvidence(GeometricVerifier())
    views = [make_depth_view(frame(0.25 * STEP_M * i)) for i in range(6)]
    views = [replace(view, settings=replace(view.settings, witness_m=STEP_M)) for view in views]
    for i, view in enumerate(views):
        at = Hypothesis(0, true_pose(0.0, 0.25 * STEP_M * i), 0.0, 0.0, True, alone=0.5)
        evidence.add(view, [at] if i else None)
    told = evidence.of(0, views[0]).after
    assert list(told) == [1, 2, 3, 4, 5]
    supports = [told[number][0].support for number in told]
    assert supports[-1] == 0.0
    assert supports == sorted(supports, reverse=True)
    assert supports[0] > 0.3
    assert seconded_from_behind({}, evidence._odometry, views[0].settings) == {}
