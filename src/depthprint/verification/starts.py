"""Poses to start an alignment from: a grid about the descriptor's own alignment, and kiss-matcher's."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.projection import Projection
from depthprint.verification.depth_view import DepthView
from depthprint.verification.settings import VerificationSettings

__all__ = ["kiss_matcher_installed", "kiss_matcher_start", "pose_grid", "yaw_pose"]

FloatArray = npt.NDArray[np.float64]

_MIN_MATCHED = 8


def yaw_pose(yaw_rad: float, projection: Projection) -> FloatArray:
    """(4, 4) turn to the left about the sensor's own up, in the projection's frame."""
    return np.asarray(_from_flu(_flu_pose(0.0, 0.0, yaw_rad, 0.0)[None], projection)[0])


@lru_cache(maxsize=16)
def pose_grid(settings: VerificationSettings, projection: Projection) -> FloatArray:
    """Offsets (m, 4, 4) that the coarse search tries, in the projection's frame, the first the identity."""
    poses = [
        _flu_pose(forward, sideways, yaw, pitch)
        for yaw in settings.yaw_rad
        for pitch in settings.pitch_rad
        for forward in settings.forward_m
        for sideways in settings.sideways_m
    ]
    grid = _from_flu(np.stack(poses), projection)
    grid.setflags(write=False)
    return grid


def kiss_matcher_installed() -> bool:
    """Whether kiss-matcher can be imported; it has no wheel for every Python."""
    from importlib.util import find_spec

    return find_spec("kiss_matcher") is not None


def kiss_matcher_start(query: DepthView, match: DepthView) -> FloatArray | None:
    """T_match_query (4, 4) by matching features of the two clouds, or None where too few agree.

    Source: Lim et al., KISS-Matcher, ICRA 2025, by the package of that name, which must be installed.
    """
    import kiss_matcher

    voxel_m = 2 * query.settings.voxel_m
    matcher = kiss_matcher.KISSMatcher(voxel_m)
    solution = matcher.estimate(list(_thinned(query.points, voxel_m)), list(_thinned(match.points, voxel_m)))
    if matcher.get_num_final_inliers() < _MIN_MATCHED:
        return None
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = solution.rotation, np.ravel(solution.translation)
    return pose if np.isfinite(pose).all() else None


def _thinned(points: npt.NDArray[np.float32], voxel_m: float) -> npt.NDArray[np.float32]:
    """One point of each voxel."""
    voxel = np.floor(points / voxel_m).astype(np.int64)
    _, first = np.unique(voxel, axis=0, return_index=True)
    return np.asarray(points[np.sort(first)])


def _flu_pose(forward: float, sideways: float, yaw: float, pitch: float) -> FloatArray:
    c, s, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    pose = np.eye(4)
    pose[:3, :3] = np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)]) @ np.array(
        [(cp, 0, sp), (0, 1, 0), (-sp, 0, cp)]
    )
    pose[:3, 3] = (forward, sideways, 0.0)
    return pose


def _from_flu(poses: FloatArray, projection: Projection) -> FloatArray:
    turn = np.eye(4)
    turn[:3, :3] = projection.R_flu_sensor
    return np.asarray(turn.T @ poses @ turn)
