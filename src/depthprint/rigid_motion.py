"""Poses (4, 4) of rigid motion: their inverse, and how far one turns."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["inverse_pose", "rotation_angle"]

FloatArray = npt.NDArray[np.float64]


def inverse_pose(T: npt.ArrayLike) -> FloatArray:
    """Inverse of rigid poses (..., 4, 4), without a solver's rounding."""
    poses = np.asarray(T, dtype=np.float64)
    out = np.zeros_like(poses)
    turn = np.swapaxes(poses[..., :3, :3], -1, -2)
    out[..., :3, :3] = turn
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", turn, poses[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def rotation_angle(T: npt.ArrayLike) -> FloatArray:
    """Angles (...), radians in [0, pi], of poses (..., 4, 4) or rotations (..., 3, 3).

    From the sine and the cosine both: the trace alone is blind to small angles.
    """
    R = np.asarray(T, dtype=np.float64)
    axis = np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1
    )
    trace = R[..., 0, 0] + R[..., 1, 1] + R[..., 2, 2]
    return np.asarray(np.arctan2(np.linalg.norm(axis, axis=-1), trace - 1.0))
