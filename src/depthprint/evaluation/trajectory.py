"""Errors of a trajectory against the true one: absolute after alignment, and relative over a distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.io.poses import check_poses
from depthprint.rigid_motion import inverse_pose, rotation_angle

__all__ = ["RelativeError", "absolute_trajectory_error", "align_trajectory", "relative_pose_error"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RelativeError:
    """Root mean square errors of ``pairs`` motions over a distance: a share of it, and degrees per metre."""

    translation_share: float
    rotation_deg_per_m: float
    pairs: int


def align_trajectory(estimated: npt.ArrayLike, true: npt.ArrayLike) -> FloatArray:
    """Estimated poses (n, 4, 4) moved as one rigid body so that positions fit the true ones by least squares.

    Closed form of Umeyama (PAMI 1991) without scale. Raises DataError for what are no poses, or not as many of each.
    """
    moved, target = _pair(estimated, true)
    p, q = moved[:, :3, 3], target[:, :3, 3]
    U, _, Vt = np.linalg.svd((q - q.mean(0)).T @ (p - p.mean(0)))
    sign = np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    T = np.eye(4)
    T[:3, :3] = U @ sign @ Vt
    T[:3, 3] = q.mean(0) - T[:3, :3] @ p.mean(0)
    return np.asarray(T @ moved)


def absolute_trajectory_error(estimated: npt.ArrayLike, true: npt.ArrayLike) -> float:
    """Root mean square distance of positions, metres, after ``align_trajectory`` (Sturm et al., IROS 2012)."""
    aligned = align_trajectory(estimated, true)
    offset = aligned[:, :3, 3] - check_poses(true, "true trajectory")[:, :3, 3]
    return float(np.sqrt((offset**2).sum(axis=1).mean()))


def relative_pose_error(
    estimated: npt.ArrayLike, true: npt.ArrayLike, distance_m: float = 100.0
) -> RelativeError:
    """Errors of the motion from each frame to the first one that lies ``distance_m`` further along the true path.

    As KITTI's odometry benchmark measures, at one distance. Raises DataError as ``align_trajectory`` and when the path
    is shorter, SettingsError for a distance that is not positive.
    """
    if not (np.isfinite(distance_m) and distance_m > 0):
        raise SettingsError(f"distance_m: expected a length > 0, got {distance_m}")
    moved, target = _pair(estimated, true)
    steps = np.linalg.norm(np.diff(target[:, :3, 3], axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    ends = np.searchsorted(arc, arc + distance_m)
    starts = np.flatnonzero(ends < len(arc))
    if not len(starts):
        raise DataError(f"true trajectory: expected at least {distance_m:g} m of path, got {arc[-1]:.4g} m")
    ends = ends[starts]
    motions = [inverse_pose(poses[starts]) @ poses[ends] for poses in (moved, target)]
    errors = inverse_pose(motions[1]) @ motions[0]
    length = arc[ends] - arc[starts]
    angles = np.degrees(rotation_angle(errors))
    shifts = np.linalg.norm(errors[:, :3, 3], axis=1)
    return RelativeError(_rms(shifts / length), _rms(angles / length), len(starts))


def _pair(estimated: npt.ArrayLike, true: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    first, second = check_poses(estimated, "estimated trajectory"), check_poses(true, "true trajectory")
    if len(first) != len(second) or not len(first):
        raise DataError(f"trajectories: expected as many poses of each, got {len(first)} and {len(second)}")
    return first, second


def _rms(values: FloatArray) -> float:
    return float(np.sqrt((values**2).mean()))
