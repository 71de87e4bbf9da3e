"""Poses to start an alignment of planar scans from: those under which the scans correlate best."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from depthprint.verification.depth_view import DepthView
from depthprint.verification.scan_alignment import spatial_pose

__all__ = ["correlated_starts"]

FloatArray = npt.NDArray[np.float64]

# Points tell up to this range. How near the other scan comes to one is told by a deviation that grows with range:
# there points lie further apart, and a turn between two that are tried moves them more.
_REACH_M = 30.0
_DEVIATION_M, _DEVIATION_SHARE = 0.12, 0.02
_CELL_M, _YAW_STEP_RAD = 0.1, math.radians(2.0)
# Windows of up to 2 ** (levels - 1) cells are ruled out at once.
_LEVELS = 4
# Poses so near lead to the same place; one that correlates less than this share of the best is not tried.
_BESIDE_M, _BESIDE_RAD = 0.5, math.radians(6.0)
_LEAST_SHARE = 0.7
# Whole numbers that points count by, in the mean.
_MEAN_WEIGHT = 16


def correlated_starts(query: DepthView, match: DepthView, yaw_rad: float | None) -> FloatArray:
    """Poses T_match_query (k, 4, 4) under which two planar scans correlate best, the best first.

    At most as many as the settings refine, none beside another; none where the query has no point within reach. The
    first is the best of all on a grid of 0.1 m and 2 degrees, within the extremes of the settings' offsets and of
    their turns about ``yaw_rad``, or at any turn for None.
    Points count by the square root of `row_weights`, lest the walls beside the sensor outvote all else.
    Source: Olson, Real-time correlative scan matching, ICRA 2009; searched by branch and bound, as Hess et al.,
    Real-time loop closure in 2D LIDAR SLAM, ICRA 2016, do.
    """
    from depthprint._kernels.scan_correlation import best_correlations

    settings = match.settings
    points = query.counted[:, :2].astype(np.float64)
    near = np.hypot(points[:, 0], points[:, 1]) < _REACH_M
    if not near.any():
        return np.empty((0, 4, 4))
    points, weights = points[near], np.sqrt(query.weights[near].astype(np.float64))
    shares = np.maximum(1, np.rint(_MEAN_WEIGHT * weights / weights.mean())).astype(np.int64)
    ahead, aside = (
        round(max(map(abs, offsets)) / _CELL_M) for offsets in (settings.forward_m, settings.sideways_m)
    )
    most_rad = math.pi if yaw_rad is None else max(map(abs, settings.yaw_rad))
    steps = math.ceil(most_rad / _YAW_STEP_RAD)
    yaws = (0.0 if yaw_rad is None else yaw_rad) + _YAW_STEP_RAD * np.arange(-steps, steps + 1)
    # No offset brings a point to the margin.
    size = 2 * (math.ceil(_REACH_M / _CELL_M) + max(ahead, aside) + 2**_LEVELS)
    poses = np.empty((settings.refined_starts, 3))
    found = best_correlations(
        points, shares, _nearness(match, size), _CELL_M, yaws, ahead, aside,
        round(_BESIDE_M / _CELL_M), _BESIDE_RAD, _LEAST_SHARE, poses,
    )  # fmt: skip
    return np.array([spatial_pose(pose) for pose in poses[:found]]).reshape(-1, 4, 4)


def _nearness(view: DepthView, size: int) -> npt.NDArray[np.uint8]:
    """How near the cells about a planar scan lie to it; at level l the greatest of 2^l x 2^l cells from each on.

    (levels, size, size) uint8.
    """
    from depthprint._kernels.scan_correlation import draw_points

    fields = np.zeros((_LEVELS, size, size), dtype=np.uint8)
    draw_points(view.points[:, :2].astype(np.float64), _CELL_M, _DEVIATION_M, _DEVIATION_SHARE, fields[0])
    for level in range(1, _LEVELS):
        width = 2 ** (level - 1)
        wider = fields[level - 1].copy()
        np.maximum(wider[:, :-width], wider[:, width:], out=wider[:, :-width])
        fields[level] = wider
        np.maximum(wider[:-width], wider[width:], out=fields[level, :-width])
    return fields
