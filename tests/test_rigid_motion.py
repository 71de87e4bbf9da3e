"""Inverse and angle of rigid motions, against SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from depthprint.rigid_motion import inverse_pose, rotation_angle


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-4, 0.7, np.pi / 2, 3.0, np.pi - 1e-9, np.pi])
def test_angle_is_exact_for_the_smallest_and_the_largest_turns(angle):
    axis = np.array([0.36, -0.48, 0.8])
    assert rotation_angle(Rotation.from_rotvec(angle * axis).as_matrix()) == pytest.approx(
        angle, rel=1e-9, abs=1e-15
    )


def test_angles_of_stacked_poses_are_those_of_scipy():
    turns = Rotation.random(50, random_state=3)
    poses = np.tile(np.eye(4), (50, 1, 1))
    poses[:, :3, :3] = turns.as_matrix()
    assert np.allclose(rotation_angle(poses), turns.magnitude(), atol=1e-12)


def test_inverse_undoes_stacked_poses():
    rng = np.random.default_rng(5)
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, :3, :3] = Rotation.random(20, random_state=4).as_matrix()
    poses[:, :3, 3] = rng.normal(0.0, 100.0, (20, 3))
    assert np.allclose(inverse_pose(poses) @ poses, np.eye(4), atol=1e-12)
