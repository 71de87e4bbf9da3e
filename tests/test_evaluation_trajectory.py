"""Errors of trajectories, against closed forms and another library; simulated odometry and its drift."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.trajectory import (
    absolute_trajectory_error,
    align_trajectory,
    relative_pose_error,
)
from depthprint.pose_graph import inverse_pose
from depthprint.simulation.odometry import OdometryNoise, simulate_odometry

NONE = OdometryNoise(0.0, 0.0, 0.0, 0.0, 0.0)


def wandering(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    motion = np.tile(np.eye(4), (n, 1, 1))
    motion[:, :3, :3] = Rotation.from_rotvec(rng.normal(0, 0.05, (n, 3))).as_matrix()
    motion[:, :3, 3] = (1.0, 0.0, 0.0)
    poses = np.empty((n, 4, 4))
    here = np.eye(4)
    for i in range(n):
        here = here @ motion[i]
        poses[i] = here
    return poses


def straight(n: int) -> np.ndarray:
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = np.arange(n)
    return poses


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_a_trajectory_moved_as_one_body_has_no_error(seed):
    true = wandering(60, seed)
    move = np.eye(4)
    move[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    move[:3, 3] = np.random.default_rng(seed).normal(0, 50, 3)
    moved = move @ true
    np.testing.assert_allclose(align_trajectory(moved, true), true, atol=1e-8)
    assert absolute_trajectory_error(moved, true) < 1e-8
    relative = relative_pose_error(moved, true, 10.0)
    assert relative.translation_share < 1e-8
    assert relative.rotation_deg_per_m < 1e-4


def test_alignment_is_that_of_scipy():
    true, estimated = wandering(40, 1), wandering(40, 2)
    p, q = (poses[:, :3, 3] - poses[:, :3, 3].mean(0) for poses in (estimated, true))
    _, rssd = Rotation.align_vectors(q, p)
    assert absolute_trajectory_error(estimated, true) == pytest.approx(rssd / np.sqrt(40))


def test_a_scale_of_one_percent_is_one_percent_of_the_way():
    true = straight(300)
    estimated = true.copy()
    estimated[:, 0, 3] *= 1.01
    relative = relative_pose_error(estimated, true, 100.0)
    assert relative.translation_share == pytest.approx(0.01)
    assert relative.rotation_deg_per_m == 0
    assert relative.pairs == 200
    deviation = 0.01 * (np.arange(300) - 149.5)
    assert absolute_trajectory_error(estimated, true) == pytest.approx(np.sqrt((deviation**2).mean()))


def test_a_steady_turn_is_degrees_per_metre():
    true = straight(50)
    estimated = true.copy()
    estimated[:, :3, :3] = Rotation.from_euler("z", 0.3 * np.arange(50), degrees=True).as_matrix()
    assert relative_pose_error(estimated, true, 10.0).rotation_deg_per_m == pytest.approx(0.3)


def test_odometry_without_noise_is_the_true_path_and_a_seed_is_a_drive():
    true = wandering(80)
    np.testing.assert_allclose(simulate_odometry(true, NONE), true, atol=1e-9)
    first, again, other = (simulate_odometry(true, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first[-1], other[-1])
    np.testing.assert_array_equal(first[0], true[0])
    assert len(simulate_odometry(np.empty((0, 4, 4)))) == 0


def test_each_kind_of_noise_does_what_it_says():
    true = straight(401)
    ends = [simulate_odometry(true, OdometryNoise(0.1, 0.0, 0.0, 0.0, 0.0), seed=s)[-1] for s in range(200)]
    spread = np.std([end[:3, 3] for end in ends], axis=0)
    np.testing.assert_allclose(spread, 0.1 * np.sqrt(400), rtol=0.2)
    scaled = simulate_odometry(true, OdometryNoise(0.0, 0.0, 0.0, 0.05, 0.0), seed=1)
    steps = np.diff(scaled[:, 0, 3])
    assert np.ptp(steps) < 1e-9
    assert 0 < abs(steps[0] - 1) < 0.2
    turned = simulate_odometry(true, OdometryNoise(0.0, 0.0, 0.0, 0.0, 0.01), seed=1)
    turns = Rotation.from_matrix(inverse_pose(turned[:-1])[:, :3, :3] @ turned[1:, :3, :3]).as_rotvec()
    np.testing.assert_allclose(turns, np.tile(turns[0], (400, 1)), atol=1e-9)
    assert abs(turns[0, 2]) > 1e-4
    np.testing.assert_allclose(turns[0, :2], 0, atol=1e-12)


def test_a_turn_is_about_the_vertical_whatever_the_sensor_frame():
    camera = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    true = straight(30)
    true[:, :3, :3] = camera
    drifted = simulate_odometry(true, OdometryNoise(0.0, 0.01, 0.0, 0.0, 0.0), seed=5)
    np.testing.assert_allclose(drifted[:, 2, 3], 0, atol=1e-9)
    np.testing.assert_allclose(drifted[:, :3, :3] @ [0, -1, 0], np.tile([0, 0, 1.0], (30, 1)), atol=1e-9)
    assert np.abs(drifted[:, 1, 3]).max() > 0.01


def test_what_does_not_fit_is_refused():
    true = straight(20)
    with pytest.raises(DataError, match="as many poses of each, got 19 and 20"):
        absolute_trajectory_error(true[1:], true)
    bad = true.copy()
    bad[3, 0, 0] = np.nan
    with pytest.raises(DataError, match="estimated trajectory, pose 3"):
        absolute_trajectory_error(bad, true)
    with pytest.raises(DataError, match="at least 100 m of path, got 19 m"):
        relative_pose_error(true, true)
    with pytest.raises(SettingsError, match="distance_m"):
        relative_pose_error(true, true, 0.0)
    with pytest.raises(SettingsError, match="heading_rad"):
        OdometryNoise(heading_rad=-1.0)
    with pytest.raises(SettingsError, match="seed"):
        simulate_odometry(true, seed=-1)
