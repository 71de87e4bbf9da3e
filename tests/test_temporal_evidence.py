"""What earlier frames say of a match: carried along by motion, and believed only where it leads there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from depthprint.cascade.verified_recognizer import VerifiedRecognizer
from depthprint.recognizer import PlaceMatch
from depthprint.verification import GeometricVerifier, make_depth_view
from depthprint.verification.hypotheses import Hypothesis
from depthprint.verification.starts import yaw_pose
from depthprint.verification.temporal_evidence import TemporalEvidence
from place_doubles import Told
from test_depth_odometry import STEP_M, frame, true_pose
from test_verification import block_world

STRENGTH = 0.8


def hypothesis(place: int, T: np.ndarray, accepted: bool = True, support: float = 0.0) -> Hypothesis:
    return Hypothesis(place, T, STRENGTH, support, accepted)


def drive_twice(frames: int, believed_at: int, **facts) -> TemporalEvidence:
    """Places 0.. along a line, then the same line again; one frame of the second drive names its place."""
    evidence = TemporalEvidence(GeometricVerifier())
    for i in range(frames):
        evidence.add(make_depth_view(frame(STEP_M * i)))
    for i in range(frames, -1, -1):
        believed = [hypothesis(i, np.eye(4), **facts)] if i == believed_at else []
        evidence.add(make_depth_view(frame(STEP_M * i)), believed)
    return evidence


def test_motion_from_a_match_supports_the_pose_it_leads_to():
    evidence = drive_twice(5, believed_at=4)
    query = make_depth_view(frame(-0.5 * STEP_M))
    led_to = true_pose(STEP_M, -0.5 * STEP_M)
    found = evidence.of_next(query).said(1, led_to).support
    assert 0.3 * STRENGTH < found < STRENGTH
    assert evidence.of_next(query).said(2, true_pose(2 * STEP_M, -0.5 * STEP_M)).support == pytest.approx(
        found, abs=0.05
    )
    aside = led_to.copy()
    aside[1, 3] += 2.0
    assert evidence.of_next(query).said(1, aside).support == 0.0


def test_a_view_from_the_same_spot_is_no_new_witness_but_hands_on_its_own():
    query = make_depth_view(frame(0.01))
    from_here = {
        support: drive_twice(3, believed_at=0, support=support).of_next(query).said(0, np.eye(4)).support
        for support in (0.0, 0.5)
    }
    assert from_here[0.0] < 0.05
    assert from_here[0.5] == pytest.approx(0.5, abs=0.02)


def test_evidence_does_not_cross_a_break_of_odometry():
    evidence = drive_twice(3, believed_at=0)
    evidence.add(make_depth_view(frame(0.0, world=block_world(8))))
    query = make_depth_view(frame(STEP_M, world=block_world(8)))
    assert evidence.of_next(query).said(0, np.eye(4)).support == 0.0
    assert evidence.of_next(query).places_in_view([], 3, 2, 1) == {}


def test_frames_of_the_way_that_lead_elsewhere_count_as_having_said_nothing():
    evidence = TemporalEvidence(GeometricVerifier())
    for i in range(4):
        evidence.add(make_depth_view(frame(STEP_M * i)))
    right = replace(hypothesis(3, np.eye(4)), alone=0.6)
    evidence.add(make_depth_view(frame(STEP_M * 3)), [right])
    evidence.add(make_depth_view(frame(STEP_M * 2)), [replace(right, place=0)])
    evidence.add(make_depth_view(frame(STEP_M * 1.5)))
    query = make_depth_view(frame(STEP_M))
    said = evidence.of_next(query).said(1, np.eye(4))
    assert said.frames == 2
    assert said.evidence == pytest.approx(0.6)
    assert said.along_way(0.3) == pytest.approx(0.3)
    # A way of which nothing is asked leaves the support alone.
    silent = replace(query, settings=replace(query.settings, way_m=0.0))
    assert evidence.of_next(silent).said(1, np.eye(4)).frames == 0


def test_two_places_mean_one_spot_where_motion_leads_from_pose_to_pose():
    evidence = drive_twice(4, believed_at=3)
    settings = make_depth_view(frame(0.0)).settings
    here = STEP_M * 1.5
    at = {place: true_pose(STEP_M * place, here) for place in (0, 2)}
    assert evidence.one_spot(settings, 0, at[0], 2, at[2])
    assert evidence.one_spot(settings, 2, at[2], 0, at[0])
    assert evidence.one_spot(settings, 0, at[0], 2, true_pose(STEP_M * 2, here + 2.0)) is False
    # Where odometry broke between the two it cannot be told.
    evidence.add(make_depth_view(frame(0.0, world=block_world(8))))
    latest = 9
    assert evidence.one_spot(settings, 0, at[0], latest, np.eye(4)) is None


def test_the_nearest_place_to_a_pose_is_among_those_turned_alike_that_motion_joins():
    evidence = drive_twice(4, believed_at=3)
    view = make_depth_view(frame(0.0))
    here = STEP_M * 1.8
    place, pose = evidence.nearest_place(view, 0, true_pose(0.0, here), 4, math.pi)
    assert place == 2
    np.testing.assert_allclose(pose, true_pose(STEP_M * 2, here), atol=0.1)
    assert evidence.nearest_place(view, 0, true_pose(0.0, here), 2, math.pi)[0] == 1
    turned = true_pose(0.0, here) @ yaw_pose(math.radians(50), view.projection)
    place, pose = evidence.nearest_place(view, 0, turned, 4, math.radians(45))
    assert place == 0
    np.testing.assert_array_equal(pose, turned)


def test_old_hypotheses_are_forgotten():
    evidence = drive_twice(3, believed_at=0)
    here = make_depth_view(frame(0.0))
    for _ in range(16):
        evidence.add(here)
    assert evidence.of_next(here).said(0, np.eye(4)).support == 0.0


def test_places_in_view_begin_with_the_nearest():
    evidence = drive_twice(5, believed_at=3)
    query = make_depth_view(frame(1.1 * STEP_M))
    query = replace(query, settings=replace(query.settings, offset_weight=1.0))
    views = [make_depth_view(frame(STEP_M * i)) for i in range(5)]
    found = evidence.of_next(query).places_in_view(views, 5, 2, 2)
    assert next(iter(found)) == 1
    np.testing.assert_allclose(found[1], true_pose(STEP_M, 1.1 * STEP_M), atol=0.1)
    assert set(found) <= set(range(5))
    nothing = drive_twice(5, believed_at=3, accepted=False)
    assert nothing.of_next(query).places_in_view(views, 5, 2, 2) == {}


@pytest.mark.parametrize("driven", [True, False])
def test_weak_match_is_accepted_where_a_match_before_leads_to_it(driven):
    inner = Told(distance=0.2)
    recognizer = VerifiedRecognizer(inner, k=1, spread=1, climb=False, track=True)

    def described(x: float, needed: float):
        found = recognizer.describe(frame(x))
        weak = replace(
            found.view.settings,
            min_overlap=needed,
            min_overlap_seconded=0.2,
            min_overlap_motion=0.2,
            witness_m=STEP_M,
            offset_weight=1.0,
        )
        return replace(found, view=replace(found.view, settings=weak))

    # the second place asks for more agreement than any return to it has
    for i in range(4):
        recognizer.add(described(STEP_M * i, 1.0 if i == 1 else 0.3))
    if driven:
        inner.place = 3
        first = described(STEP_M * 3 + 0.1, 0.3)
        assert recognizer.query(first, limit=4)[0].verification.accepted
        recognizer.add(first)
        recognizer.add(described(STEP_M * 2, 0.3))
    inner.place = 1
    found = recognizer.query(described(STEP_M + 0.3, 0.3), k=9, limit=2)
    second = next(match for match in found if match.place == 1)
    assert second.verification is not None
    assert second.verification.accepted == driven
    assert (second.distance < 1.0) == driven
    if driven:
        alone = 1.0 - second.verification.agreement / np.sqrt(1.2)
        assert second.distance < alone


def test_further_proposals_are_checked_only_where_none_was_accepted():
    for first, asked in ((0, False), (1, True)):
        calls = []

        def further(description, limit=None, calls=calls):
            calls.append(limit)
            return [PlaceMatch(0, 0.5, shift=0.0)]

        inner = Told(distance=0.2)
        recognizer = VerifiedRecognizer(inner, k=1, spread=1, climb=False, further=further)
        for world in (3, 8):
            recognizer.add(recognizer.describe(frame(0.0, world=block_world(world))))
        inner.place = first
        best = recognizer.query(recognizer.describe(frame(0.2)), limit=2)[0]
        assert (best.place, best.verification.accepted) == (0, True)
        assert bool(calls) == asked
