"""Which of the places that a query was checked against is named its match."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.cascade.checked_places import CheckedPlaces
from depthprint.recognizer import PlaceMatch
from depthprint.verification import Verification
from depthprint.verification.hypotheses import OtherFrames


def accepted(agreement: float, offset_m: float) -> Verification:
    pose = np.eye(4)
    pose[0, 3] = offset_m
    return Verification(
        T_match_query=pose,
        inliers=100,
        rmse_m=0.1,
        overlap=0.5,
        free_space_violations=0,
        free_space_share=0.0,
        agreement=agreement,
        accepted=True,
        start="given pose",
        reason="",
        max_offset_m=8.0,
        offset_weight=1.0,
    )


def checks_of(*found: tuple[int, Verification, float]) -> CheckedPlaces:
    checks = CheckedPlaces([PlaceMatch(place, 0.5) for place, _, _ in found], spread=4)
    for place, verification, support in found:
        checks.add(place, verification, OtherFrames(support), plausible=True)
    return checks


def test_of_two_views_of_one_road_the_nearer_is_named_whatever_earlier_frames_say():
    checks = checks_of((63, accepted(0.53, 4.0), 0.5), (64, accepted(0.5, 2.0), 0.1))
    assert checks.best == 64
    # It has the evidence of the view beside it.
    assert checks.ranked()[0].place == 64
    assert checks.ranked()[0].distance == min(match.distance for match in checks.ranked())


def test_a_view_beside_it_that_would_put_the_query_elsewhere_is_not_named():
    """Along a corridor a planar scan slips, and may then agree better than where it was taken."""
    right, slipped = (63, accepted(0.45, 1.0), 0.5), (66, accepted(0.5, 0.0), 0.0)
    asked = set()

    def elsewhere(first, T_first_query, second, T_second_query):
        asked.add((first, T_first_query[0, 3], second, T_second_query[0, 3]))
        return False

    for told, slips, named in ((None, True, 66), (elsewhere, False, 66), (elsewhere, True, 63)):
        checks = CheckedPlaces([PlaceMatch(63, 0.5), PlaceMatch(66, 0.5)], 4, told, slips)
        for place, found, support in (right, slipped):
            checks.add(place, found, OtherFrames(support), plausible=True)
        assert checks.best == named
        assert checks.ranked()[0].place == named
    assert (63, 1.0, 66, 0.0) in asked


@pytest.mark.parametrize(("told", "named"), [(True, 80), (None, 63)])
def test_a_nearer_view_many_frames_on_is_named_where_it_means_the_same_spot(told, named):
    """A vehicle that turns slowly has many frames of one bend; the view that agrees most is not the nearest."""
    checks = CheckedPlaces([PlaceMatch(63, 0.5), PlaceMatch(80, 0.5)], 4, lambda *_: told)
    checks.add(63, accepted(0.7, 5.0), OtherFrames(0.6), plausible=True)
    checks.add(80, accepted(0.45, 0.2), OtherFrames(0.5), plausible=True)
    assert checks.ranked()[0].place == named


def test_of_two_roads_the_one_that_earlier_frames_lead_to_is_named():
    checks = checks_of((63, accepted(0.53, 2.0), 0.5), (200, accepted(0.6, 2.0), 0.0))
    assert checks.best == 63


def test_a_match_that_the_way_does_not_bear_out_is_less_sure():
    alone = checks_of((63, accepted(0.5, 2.0), 0.5)).ranked()[0].distance
    told = {}
    for evidence in (0.0, 2.0):
        checks = CheckedPlaces([PlaceMatch(63, 0.5)], spread=4)
        checks.add(63, accepted(0.5, 2.0), OtherFrames(0.5, evidence, frames=4), plausible=True)
        told[evidence] = checks.ranked()[0].distance
    assert alone < told[2.0] < told[0.0] < 1.0
