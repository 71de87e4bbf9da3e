"""Planar scans laid over each other where they correlate best: starts of an alignment, and how well they do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.verification.depth_view import DepthView
from depthprint.verification.scan_alignment import spatial_pose

__all__ = ["correlated_starts", "correlation_shares"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _Grid:
    """Offsets and turns that are tried. Windows of up to 2 ** (levels - 1) cells are ruled out at once."""

    cell_m: float
    yaw_step_rad: float
    levels: int


# To start an alignment from, and to tell which of many places is worth one.
_FINE = _Grid(0.1, math.radians(2.0), 4)
_COARSE = _Grid(0.2, math.radians(3.0), 3)
_COARSE_AHEAD_M, _COARSE_ASIDE_M, _COARSE_TURN_RAD = 3.0, 2.0, math.radians(30.0)
# Points tell up to this range. How near the other scan comes to one is told by a deviation that grows with range:
# there points lie further apart, and a turn between two that are tried moves them more.
_REACH_M = 30.0
_DEVIATION_M, _DEVIATION_SHARE = 0.12, 0.02
# Poses so near lead to the same place; one that correlates less than this share of the best is not tried.
_BESIDE_M, _BESIDE_RAD = 0.5, math.radians(6.0)
_LEAST_SHARE = 0.7
# Whole numbers that points count by, in the mean, and what a point counts times that lies on the other scan.
_MEAN_WEIGHT, _ON_IT = 16, 255


def correlated_starts(query: DepthView, match: DepthView, yaw_rad: float | None) -> FloatArray:
    """Poses T_match_query (k, 4, 4) under which two planar scans correlate best, the best first.

    At most as many as the settings refine, none beside another; none where the query has no point within reach. The
    first is the best of all on a grid of 0.1 m and 2 degrees, within the extremes of the settings' offsets and of
    their turns about ``yaw_rad``, or at any turn for None.
    Points count by the square root of `row_weights`, lest the walls beside the sensor outvote all else.
    Source: Olson, Real-time correlative scan matching, ICRA 2009; searched by branch and bound, as Hess et al.,
    Real-time loop closure in 2D LIDAR SLAM, ICRA 2016, do.
    """
    settings = match.settings
    ahead_m, aside_m = (max(map(abs, offsets)) for offsets in (settings.forward_m, settings.sideways_m))
    turns = _turns(_FINE, yaw_rad, max(map(abs, settings.yaw_rad)))
    poses, _ = _correlated(
        _points_and_shares(query), match, _FINE, turns, ahead_m, aside_m, settings.refined_starts
    )
    return np.array([spatial_pose(pose) for pose in poses]).reshape(-1, 4, 4)


def correlation_shares(
    query: DepthView, matches: Sequence[DepthView], yaws_rad: Sequence[float | None]
) -> FloatArray:
    """How well a planar scan correlates at best with each of others, (n,) in 0..1: 1 where all its points lie on one.

    As in `correlated_starts`, on a grid of 0.2 m and 3 degrees up to 3 m ahead, 2 m aside and 30 degrees about each
    turn: enough to tell which of many places to look at.
    """
    counted = _points_and_shares(query)
    most = max(1, _ON_IT * int(counted[1].sum()))
    shares = np.zeros(len(matches))
    for number, (match, yaw_rad) in enumerate(zip(matches, yaws_rad, strict=True)):
        turns = _turns(_COARSE, yaw_rad, _COARSE_TURN_RAD)
        _, sums = _correlated(counted, match, _COARSE, turns, _COARSE_AHEAD_M, _COARSE_ASIDE_M, 1)
        shares[number] = sums.sum() / most
    return shares


def _turns(grid: _Grid, yaw_rad: float | None, most_rad: float) -> FloatArray:
    """Turns that are tried about one, or all for None."""
    steps = math.ceil((math.pi if yaw_rad is None else most_rad) / grid.yaw_step_rad)
    return np.asarray((yaw_rad or 0.0) + grid.yaw_step_rad * np.arange(-steps, steps + 1))


def _points_and_shares(view: DepthView) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Points (n, 2) within reach, and whole numbers (n,) that they count by."""
    points = view.counted[:, :2].astype(np.float64)
    near = np.hypot(points[:, 0], points[:, 1]) < _REACH_M
    weights = np.sqrt(view.weights[near].astype(np.float64))
    mean = weights.mean() if len(weights) else 1.0
    return points[near], np.maximum(1, np.rint(_MEAN_WEIGHT * weights / mean)).astype(np.int64)


def _correlated(
    counted: tuple[FloatArray, npt.NDArray[np.int64]],
    match: DepthView,
    grid: _Grid,
    turns: FloatArray,
    ahead_m: float,
    aside_m: float,
    count: int,
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Up to ``count`` poses x, y, yaw (k, 3) under which points correlate best with a scan, and their sums (k,)."""
    from depthprint._kernels.scan_correlation import best_correlations

    ahead, aside = round(ahead_m / grid.cell_m), round(aside_m / grid.cell_m)
    # No offset brings a point to the margin.
    size = 2 * (math.ceil(_REACH_M / grid.cell_m) + max(ahead, aside) + 2**grid.levels)
    poses, sums = np.empty((count, 3)), np.empty(count, dtype=np.int64)
    found = best_correlations(
        *counted, _nearness(match, grid, size), grid.cell_m, turns, ahead, aside,
        round(_BESIDE_M / grid.cell_m), _BESIDE_RAD, _LEAST_SHARE, poses, sums,
    )  # fmt: skip
    return poses[:found], sums[:found]


def _nearness(view: DepthView, grid: _Grid, size: int) -> npt.NDArray[np.uint8]:
    """How near the cells about a planar scan lie to it; at level l the greatest of 2^l x 2^l cells from each on.

    (levels, size, size) uint8.
    """
    from depthprint._kernels.scan_correlation import draw_points

    fields = np.zeros((grid.levels, size, size), dtype=np.uint8)
    draw_points(view.points[:, :2].astype(np.float64), grid.cell_m, _DEVIATION_M, _DEVIATION_SHARE, fields[0])
    for level in range(1, grid.levels):
        width = 2 ** (level - 1)
        wider = fields[level - 1].copy()
        np.maximum(wider[:, :-width], wider[:, width:], out=wider[:, :-width])
        fields[level] = wider
        np.maximum(wider[:-width], wider[width:], out=fields[level, :-width])
    return fields
