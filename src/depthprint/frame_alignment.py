"""The relative pose of two frames, by aligning their points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, MissingExtraError, SettingsError
from depthprint.io.poses import check_poses
from depthprint.range_image import RangeImage
from depthprint.voxels import voxel_points

__all__ = ["FrameAlignment", "align_frames", "align_points"]

FloatArray = npt.NDArray[np.float64]

# Voxels grow with what is seen: 0.4 m on a street seen 16 m away, 5 cm in a room.
_VOXEL_SHARE, _LEAST_VOXEL_M = 0.025, 0.05
_REACH_VOXELS = 8
_LEAST_POINTS = 20
_ITERATIONS = 30


@dataclass(frozen=True)
class FrameAlignment:
    """Where a query's sensor was in the frame of a match's: T_match_query (4, 4) float64.

    inliers: points of the query that have one of the match within reach; overlap: their share of the query's points,
    or of the match's the other way, whichever is less.
    """

    T_match_query: FloatArray
    inliers: int
    overlap: float


def align_frames(
    query: RangeImage, match: RangeImage, yaw_rad: float = 0.0, *, least_overlap: float = 0.5
) -> FrameAlignment | None:
    """Align two frames of one place; None where less than ``least_overlap`` of either agrees with the other.

    yaw_rad: turn of T_match_query about 'up' to start from. Points are thinned to voxels whose side grows with the
    median range. Raises SettingsError for a turn that is not finite or a share outside 0..1, and as ``align_points``.
    """
    if not math.isfinite(yaw_rad) or not 0 <= least_overlap <= 1:
        raise SettingsError(
            f"align_frames: expected a finite yaw_rad and least_overlap in 0..1, got {yaw_rad}, {least_overlap}"
        )
    R = query.projection.R_flu_sensor
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    start = np.eye(4)
    start[:3, :3] = R.T @ np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)]) @ R
    voxel_m = max(_LEAST_VOXEL_M, _VOXEL_SHARE * float(np.nanmedian(query.require_returns().ranges_m)))
    found = align_points(
        voxel_points(query, voxel_m),
        voxel_points(match, voxel_m),
        [start],
        voxel_m=voxel_m,
        reach_m=_REACH_VOXELS * voxel_m,
    )
    return found if found is not None and found.overlap >= least_overlap else None


def align_points(
    query_xyz: npt.ArrayLike,
    match_xyz: npt.ArrayLike,
    starts: Sequence[npt.ArrayLike] = (),
    *,
    voxel_m: float = 0.25,
    reach_m: float = 1.0,
) -> FrameAlignment | None:
    """Align points (n, 3) of a query to those (m, 3) of a match, metres, each in its own sensor's frame.

    Generalised ICP (Segal, Haehnel, Thrun, RSS 2009) of small_gicp, from each of ``starts``, poses T_match_query (the
    identity when there are none); the one that ends with the most overlap counts. voxel_m: to which both are thinned
    first. reach_m: how far apart points may be matched at first; a quarter of it in the end, and for the overlap, which
    tells a good alignment from a bad one. None when too few points are left. Raises DataError for what are no points or
    poses, SettingsError for lengths that are not positive, MissingExtraError without small_gicp.
    """
    if not (voxel_m > 0 and reach_m > 0 and np.isfinite([voxel_m, reach_m]).all()):
        raise SettingsError(f"align_points: expected lengths > 0, got {voxel_m} and {reach_m}")
    query, match = _points(query_xyz, "query"), _points(match_xyz, "match")
    first = check_poses(np.asarray(starts if len(starts) else [np.eye(4)], dtype=np.float64), "starts")
    gicp = _small_gicp()
    source, _ = gicp.preprocess_points(query, downsampling_resolution=voxel_m, num_threads=1)
    target, target_tree = gicp.preprocess_points(match, downsampling_resolution=voxel_m, num_threads=1)
    if min(source.size(), target.size()) < _LEAST_POINTS:
        return None
    found: list[FrameAlignment] = []
    for start in first:
        T = start
        for reach in (reach_m, reach_m / 4):
            result = gicp.align(
                target,
                source,
                target_tree,
                T,
                registration_type="GICP",
                max_correspondence_distance=reach,
                num_threads=1,
                max_iterations=_ITERATIONS,
            )
            T = np.array(result.T_target_source, dtype=np.float64)
        if np.isfinite(T).all():
            found.append(_measured(T, source.points()[:, :3], target.points()[:, :3], reach_m / 4))
    return max(found, key=lambda alignment: alignment.overlap, default=None)


def _measured(
    T_match_query: FloatArray, query: FloatArray, match: FloatArray, within_m: float
) -> FrameAlignment:
    from scipy.spatial import cKDTree

    moved = query @ T_match_query[:3, :3].T + T_match_query[:3, 3]
    near = np.isfinite(cKDTree(match).query(moved, distance_upper_bound=within_m)[0])
    back = np.isfinite(cKDTree(moved).query(match, distance_upper_bound=within_m)[0])
    T_match_query.setflags(write=False)
    return FrameAlignment(T_match_query, int(near.sum()), float(min(near.mean(), back.mean())))


def _points(points_xyz: npt.ArrayLike, name: str) -> FloatArray:
    points = np.asarray(points_xyz, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise DataError(
            f"align_points: expected finite points (n, 3) of the {name}, got shape {points.shape}"
        )
    return points


def _small_gicp() -> Any:
    try:
        import small_gicp
    except ImportError as error:
        raise MissingExtraError("aligning frames needs small_gicp: pip install 'depthprint[slam]'") from error
    return small_gicp
