"""The heading carried along: what turns add up to, what matches hold, and what a match against it keeps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from depthprint.cascade.verified_recognizer import VerifiedRecognizer
from depthprint.range_image import RangeImage
from depthprint.simulation.meshes import merge
from depthprint.simulation.ray_casting import RayScene
from depthprint.verification import GeometricVerifier, make_depth_view
from depthprint.verification.depth_odometry import DepthOdometry
from depthprint.verification.heading import HeadingTrack
from depthprint.verification.hypotheses import Hypothesis
from depthprint.verification.starts import yaw_pose
from depthprint.verification.temporal_evidence import TemporalEvidence
from depthprint.verification.turns import Turn, turn_by_walls, turn_of
from place_doubles import Told
from test_depth_odometry import STEP_M, frame
from test_verification import HAND_HELD, ROW, SPINNING, block_world, box, pose_at

STILL = Turn(0.0, 0.0)


def track(*turns_deg: float, sd_deg: float = 1.0) -> HeadingTrack:
    headings = HeadingTrack()
    for turn in turns_deg:
        headings.add(Turn(math.radians(turn), math.radians(sd_deg) ** 2))
    return headings


@pytest.mark.parametrize("projection", [HAND_HELD, SPINNING, ROW], ids=lambda p: type(p).__name__)
@pytest.mark.parametrize("degrees", [0.0, 25.0, -130.0])
def test_turn_of_a_pose_is_to_the_left_about_the_sensors_up(projection, degrees):
    assert math.degrees(turn_of(yaw_pose(math.radians(degrees), projection), projection)) == pytest.approx(
        degrees
    )


def test_match_along_the_heading_keeps_all_and_one_against_it_little():
    headings = track(0, 40, 40, 40, 60)
    assert headings.share(0, math.radians(180), STILL) == pytest.approx(1.0)
    assert headings.share(0, 0.0, STILL) < 0.21
    assert headings.share(0, math.radians(170), Turn(math.radians(-10), 0.0)) == pytest.approx(1.0)
    assert headings.share(3, math.radians(60 - 45), STILL, slack_rad=math.radians(46)) == pytest.approx(1.0)


def test_full_turns_do_not_count():
    assert track(*[36] * 21).share(0, 0.0, STILL) == pytest.approx(1.0)


@given(st.floats(-10, 10), st.floats(0, 5))
def test_share_lies_between_its_bounds_and_falls_with_the_angle(turn_rad, variance):
    headings = track(0, 20, -50)
    share = headings.share(0, turn_rad, Turn(0.3, variance))
    nearer = headings.share(0, turn_rad, Turn(0.3, variance), slack_rad=0.2)
    assert 0.2 <= share <= nearer <= 1.0


def test_more_lost_on_the_way_means_less_doubt():
    shares = [track(0, *[0] * 20, sd_deg=sd).share(0, math.pi / 2, STILL) for sd in (1, 5, 10, 20)]
    assert shares == sorted(shares)
    assert shares[0] < 0.21 < 0.5 < shares[-1]


def test_likely_match_pulls_the_heading_and_an_unlikely_one_does_not():
    drifted = track(0, *[4] * 20, sd_deg=12.0)
    before = drifted.share(0, 0.0, STILL)
    drifted.hold(0, math.radians(-100))
    assert drifted.share(0, 0.0, STILL) == before
    drifted.hold(0, 0.0)
    assert drifted.share(0, 0.0, STILL) > before
    assert drifted.share(0, math.pi / 2, STILL) < 0.4


def room(yaw_rad: float, *, round_wall: bool = False) -> RangeImage:
    """A planar scan in a room of 9 x 7 m, or in a round one, turned to the left."""
    angles = ROW.angle_min_rad + ROW.angle_step_rad * np.arange(ROW.width) + yaw_rad
    to_wall = [np.where(s * f > 1e-9, d / np.maximum(s * f, 1e-9), np.inf) for f, d, s in (
        (np.cos(angles), 5.0, 1), (np.cos(angles), 4.0, -1), (np.sin(angles), 4.0, 1), (np.sin(angles), 3.0, -1),
    )]  # fmt: skip
    ranges_m = np.full(ROW.width, 4.0) if round_wall else np.min(to_wall, axis=0)
    return RangeImage(ranges_m[None].astype(np.float32), ROW)


@pytest.mark.parametrize("degrees", [-33.0, 4.0, 20.0])
def test_walls_tell_the_turn_of_a_scan(degrees):
    first, second = make_depth_view(room(0.3)), make_depth_view(room(0.3 + math.radians(degrees)))
    found = turn_by_walls(first, second)
    assert found is not None
    assert math.degrees(found) == pytest.approx(degrees, abs=2.0)


def test_walls_of_another_shape_tell_nothing():
    square, round_one = make_depth_view(room(0.0)), make_depth_view(room(0.0, round_wall=True))
    assert turn_by_walls(square, round_one) is None


def test_a_step_that_does_not_agree_still_has_a_turn_of_large_variance():
    odometry = DepthOdometry(GeometricVerifier())
    assert odometry.turn_to(make_depth_view(frame(0.0))) == STILL
    odometry.add(make_depth_view(frame(0.0)))
    followed = odometry.turn_to(make_depth_view(frame(STEP_M, yaw=0.2 + math.radians(20))))
    assert math.degrees(followed.left_rad) == pytest.approx(20, abs=1)
    lost = odometry.turn_to(make_depth_view(frame(0.0, world=block_world(8))))
    assert lost.variance > 10 * followed.variance


def test_a_sensor_held_in_the_hand_has_no_heading():
    evidence = TemporalEvidence(GeometricVerifier())
    view = make_depth_view(frame(0.0))
    evidence.add(view)
    assert evidence.heading_share(view, 0, math.pi) < 0.21
    held = make_depth_view(frame(0.0), replace(view.settings, upright=False))
    assert evidence.heading_share(held, 0, math.pi) == 1.0
    assert TemporalEvidence(GeometricVerifier(), heading=False).heading_share(view, 0, math.pi) == 1.0


def test_after_the_places_of_a_map_a_frame_of_elsewhere_has_any_heading():
    evidence = TemporalEvidence(GeometricVerifier())
    for i in range(3):
        evidence.add(make_depth_view(frame(STEP_M * i)))
    going_on = make_depth_view(frame(3 * STEP_M))
    assert evidence.heading_share(going_on, 0, math.pi) < 0.21
    elsewhere = make_depth_view(frame(0.0, world=block_world(8)))
    assert evidence.heading_share(elsewhere, 0, math.pi) > 0.7
    evidence.add(elsewhere, [])
    following = make_depth_view(frame(STEP_M, world=block_world(8)))
    assert evidence.heading_share(following, 0, math.pi) > 0.7
    assert evidence.heading_share(following, 3, math.pi) < 0.21


@pytest.mark.parametrize(("told", "holds"), [(0.7, True), (0.3, False)])
def test_a_match_holds_the_heading_where_its_whole_way_bears_it_out(told, holds):
    evidence = TemporalEvidence(GeometricVerifier())
    for i in range(3):
        evidence.add(make_depth_view(frame(STEP_M * i)))
    evidence.add(make_depth_view(frame(0.0, world=block_world(8))), [])
    turned = yaw_pose(math.radians(90), ROW)
    match = Hypothesis(0, turned, 0.9, 0.8, accepted=True, alone=0.5, told=told)
    evidence.add(make_depth_view(frame(STEP_M, world=block_world(8))), [match])
    following = make_depth_view(frame(2 * STEP_M, world=block_world(8)))
    assert evidence.heading_share(following, 0, math.radians(90)) > 0.95
    assert (evidence.heading_share(following, 0, math.radians(-90)) < 0.21) == holds


def symmetric_hall() -> RayScene:
    """Boxes along a hall that looks the same after half a turn about its middle; simulated."""
    rng = np.random.default_rng(5)
    boxes = [box((0.0, sign * 9.0, 2.0), (60.0, 0.2, 4.0)) for sign in (1, -1)]
    for _ in range(14):
        x, y = rng.uniform(-24, 24), rng.choice([-1, 1]) * rng.uniform(3.5, 7)
        sizes = (*rng.uniform(1, 4, 2), 4.0)
        boxes += [box((sign * x, sign * y, 2.0), sizes) for sign in (1, -1)]
    return RayScene(merge(boxes))


def driven_and_turned() -> list[RangeImage]:
    """From one end of the hall to the other, and about: what is seen last is what was seen first."""
    hall = symmetric_hall()
    poses = [(x, 0.0) for x in np.arange(-8.0, 8.1, 1.0)] + [
        (8.0, math.radians(a)) for a in range(30, 181, 30)
    ]
    return [
        RangeImage(hall.cast(ROW, pose_at(ROW, x, 0.0, yaw, 0.5)), ROW, sensor_height_m=0.5)
        for x, yaw in poses
    ]


def test_a_match_that_only_looks_alike_from_the_other_side_counts_for_little():
    views = driven_and_turned()
    said = {}
    for heading in (True, False):
        recognizer = VerifiedRecognizer(Told(0), climb=False, track=True, heading=heading)
        for image in views[:-1]:
            recognizer.add(recognizer.describe(image))
        best = recognizer.query(recognizer.describe(views[-1]), limit=1)[0]
        assert best.verification is not None
        assert best.verification.accepted
        said[heading] = 1.0 - best.distance
    assert said[False] > 0.5
    assert said[True] < 0.3 * said[False]
