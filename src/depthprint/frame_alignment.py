"""The relative pose of two frames, by aligning their points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, MissingExtraError, SettingsError
from depthprint.io.poses import check_poses

__all__ = ["FrameAlignment", "align_points"]

FloatArray = npt.NDArray[np.float64]

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
