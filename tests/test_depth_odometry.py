"""Motion from frame to frame, and the places that it says are in view again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depthprint.cascade.verified_recognizer import VerifiedRecognizer
from depthprint.range_image import RangeImage
from depthprint.verification import GeometricVerifier, make_depth_view
from depthprint.verification.depth_odometry import DepthOdometry
from place_doubles import Told
from test_verification import ROW, block_world, pose_at, pose_error

STEP_M = 0.9
WORLD = block_world(3)


def frame(x: float, y: float = 0.0, yaw: float = 0.2, world=WORLD) -> RangeImage:
    return RangeImage(world.cast(ROW, pose_at(ROW, x, y, yaw, 0.5)), ROW, sensor_height_m=0.5)


def true_pose(first: float, second: float) -> np.ndarray:
    return np.linalg.inv(pose_at(ROW, first, 0.0, 0.2, 0.5)) @ pose_at(ROW, second, 0.0, 0.2, 0.5)


def odometry_along(positions: list[float]) -> DepthOdometry:
    odometry = DepthOdometry(GeometricVerifier())
    for x in positions:
        odometry.add(make_depth_view(frame(x)))
    return odometry


def test_steps_add_up_to_the_way_driven():
    odometry = odometry_along([STEP_M * i for i in range(6)])
    found = odometry.pose_of_next(0, make_depth_view(frame(STEP_M * 6)))
    assert found is not None
    metres, degrees = pose_error(found, true_pose(0.0, STEP_M * 6))
    assert metres < 0.1
    assert degrees < 0.5


def test_places_near_a_pose_are_those_within_reach():
    odometry = odometry_along([STEP_M * i for i in range(6)])
    numbers, poses = odometry.places_near(1, np.eye(4), below=4, reach_m=10.0)
    assert numbers.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(poses[1], np.eye(4), atol=1e-12)
    metres, _ = pose_error(poses[3], true_pose(STEP_M * 3, STEP_M))
    assert metres < 0.1
    assert odometry.places_near(1, np.eye(4), below=4, reach_m=1.5 * STEP_M)[0].tolist() == [0, 1, 2]
    ahead = true_pose(STEP_M, STEP_M * 5)
    assert odometry.places_near(1, ahead, below=6, reach_m=0.5 * STEP_M)[0].tolist() == [5]
    assert odometry.places_near(1, ahead, below=4, reach_m=0.5 * STEP_M)[0].tolist() == []


def test_a_view_of_elsewhere_starts_another_chain():
    odometry = odometry_along([0.0, STEP_M])
    elsewhere = make_depth_view(frame(0.0, world=block_world(8)))
    assert odometry.pose_of_next(0, elsewhere) is None
    odometry.add(elsewhere)
    assert odometry.pose_of_next(1, make_depth_view(frame(STEP_M, world=block_world(8)))) is None
    assert odometry.places_near(2, np.eye(4), below=3, reach_m=100.0)[0].tolist() == [2]
    assert odometry.pose_of_next(2, make_depth_view(frame(STEP_M, world=block_world(8)))) is not None


def test_a_stop_does_not_hold_the_step_after_it():
    there = 3 * STEP_M
    odometry = odometry_along([0.0, there, there])
    found = odometry.pose_of_next(2, make_depth_view(frame(there - STEP_M)))
    assert found is not None
    metres, _ = pose_error(found, true_pose(there, there - STEP_M))
    assert metres < 0.1


def test_a_planar_scan_is_followed_round_a_corner():
    odometry = DepthOdometry(GeometricVerifier())
    odometry.add(make_depth_view(frame(0.0)))
    turned = make_depth_view(frame(0.3, yaw=0.2 + np.radians(50)))
    found = odometry.pose_of_next(0, turned)
    assert found is not None
    true = np.linalg.inv(pose_at(ROW, 0.0, 0.0, 0.2, 0.5)) @ pose_at(ROW, 0.3, 0.0, 0.2 + np.radians(50), 0.5)
    metres, degrees = pose_error(found, true)
    assert metres < 0.1
    assert degrees < 0.5
    ahead_only = replace(turned, settings=replace(turned.settings, motion_yaw_rad=(0.0,)))
    assert odometry.pose_of_next(0, ahead_only) is None


def test_nothing_precedes_the_first_view():
    assert DepthOdometry(GeometricVerifier()).pose_of_next(0, make_depth_view(frame(0.0))) is None


@pytest.mark.parametrize("track", [True, False])
def test_tracking_finds_places_that_nobody_proposes(track):
    # Ten places along a street; then a return to the second, and on by steps that skip places.
    recognizer = VerifiedRecognizer(Told(1), climb=False, consistency=0, track=track)
    for i in range(10):
        recognizer.add(recognizer.describe(frame(STEP_M * i)))
    named = []
    for x in (1.0, 2.9, 4.8, 6.7):
        description = recognizer.describe(frame(STEP_M * x, y=0.3))
        best = recognizer.query(description, limit=10)[0]
        recognizer.add(description)
        named.append((best.place, best.distance < 1))
    assert named[0] == (1, True)
    if track:
        assert [accepted for _, accepted in named] == [True] * 4
        assert all(abs(place - x) <= 1 for (place, _), x in zip(named[1:], (2.9, 4.8, 6.7), strict=True))
    else:
        assert named[-1][0] == 1
