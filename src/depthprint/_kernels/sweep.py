"""Relaxed bounds in float32 of all items of an index, LANES of them side by side.

Least squared distances come from products: |p - q|^2 = |p|^2 + |q|^2 - 2 p q. What float32 may have rounded,
in the products and in the points themselves, is taken off, so that what is returned is a lower bound.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from depthprint._kernels.ground import PairRules
from depthprint._kernels.relaxation import normalise, relaxed_work
from depthprint._kernels.tiles import LANES, TILE_ROWS, load_column, meet_column, weigh_least

__all__ = ["QueryTiles", "gather_items", "sweep_bounds", "tile_query"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

_FAR = np.float32(-1e38)
_FARTHEST = np.float32(-3e38)
_GROUPS_PER_TASK = 8
_UNDERFLOW = 1e-36  # squares below it are lost in float32


class QueryTiles(NamedTuple):
    """Points of a query in tiles, those missing from the last one being far from everything."""

    points: Float32Array  # (tiles, dims, TILE_ROWS)
    halves: Float32Array  # (tiles, TILE_ROWS): -|p|^2 / 2
    weights: FloatArray  # (m,)
    mass: float
    complexity: float
    slack_squared: float  # more than float32 may add to a squared distance
    slack: float  # and to a distance


def tile_query(
    points: FloatArray, weights: FloatArray, mass: float, complexity: float, largest_norm: float
) -> QueryTiles:
    """Tiles of points (m, dims) that are to meet points of norm ``largest_norm`` or less."""
    m, dims = points.shape
    tiles = -(-m // TILE_ROWS)
    padded = np.zeros((tiles * TILE_ROWS, dims), np.float32)
    padded[:m] = points
    squares = (padded.astype(np.float64) ** 2).sum(axis=1)
    halves = np.full(tiles * TILE_ROWS, _FAR)
    halves[:m] = -0.5 * squares[:m]
    reach = float(np.sqrt(squares.max(initial=0.0))) * (1.0 + 1e-6) + largest_norm
    return QueryTiles(
        np.ascontiguousarray(padded.reshape(tiles, TILE_ROWS, dims).transpose(0, 2, 1)),
        halves.reshape(tiles, TILE_ROWS),
        weights[:m],
        mass,
        complexity,
        2.4e-7 * (dims + 8) * reach * reach + _UNDERFLOW,
        2.4e-7 * reach,
    )


@njit(cache=True, parallel=True)
def sweep_bounds(
    query: QueryTiles,
    points: Any,
    weights: Any,
    counts: IntArray,
    masses: FloatArray,
    complexities: FloatArray,
    groups: IntArray,
    rules: PairRules,
) -> FloatArray:
    """(len(groups), LANES) lower bounds of the distances of a query to the items of some groups.

    points (groups, k, d, LANES), whose first coordinates the query has, and weights (groups, k, LANES) may be
    float32 or float64. Lanes beyond the last item get 0.
    """
    out = np.zeros((len(groups), LANES))
    tiles, dims = query.halves.shape[0], query.points.shape[1]
    m, k_q = len(query.weights), points.shape[1]
    squared, slack = np.float32(query.slack_squared), np.float32(query.slack)
    shrink, most = np.float32(1.0 - 5e-7), np.float32(rules.cap * (1.0 - 1e-7))
    for task in prange((len(groups) + _GROUPS_PER_TASK - 1) // _GROUPS_PER_TASK):
        q, q_halves = np.empty((dims, LANES), np.float32), np.empty(LANES, np.float32)
        tile_rows, columns = (
            np.empty((tiles, TILE_ROWS, LANES), np.float32),
            np.empty((k_q, LANES), np.float32),
        )
        rows = tile_rows.reshape(tiles * TILE_ROWS, LANES)
        from_query, from_item = np.empty(LANES), np.empty(LANES)
        minima = np.empty((2, max(m, k_q)))
        weights_q = np.empty(k_q)
        for g in range(task * _GROUPS_PER_TASK, min(len(groups), (task + 1) * _GROUPS_PER_TASK)):
            first = groups[g] * LANES
            present = min(LANES, len(counts) - first)
            widest = counts[first : first + present].max()
            rows[:] = _FARTHEST
            columns[:widest] = _FARTHEST
            for j in range(widest):
                load_column(points, groups[g], j, q, q_halves)
                for x in range(present):
                    if j >= counts[first + x]:
                        q_halves[x] = _FAR
                for tile in range(tiles):
                    meet_column(query.points, query.halves, tile, q, q_halves, dims, tile_rows, columns, j)
            weigh_least(rows, m, query.weights, from_query, squared, slack, shrink, most)
            weigh_least(columns, widest, weights[groups[g]], from_item, squared, slack, shrink, most)
            for x in range(present):
                item = first + x
                emd = query.complexity + complexities[item]
                if query.mass > 0.0 and masses[item] > 0.0:
                    if rules.balance or query.mass == masses[item]:
                        emd = max(from_query[x], from_item[x])
                        if rules.divide:
                            emd /= min(query.mass, masses[item])
                    else:
                        n = counts[item]
                        for i in range(m):
                            minima[0, i] = rows[i, x]
                        for j in range(n):
                            minima[1, j] = columns[j, x]
                            weights_q[j] = weights[groups[g], j, x]
                        emd = relaxed_work(
                            query.weights,
                            query.mass,
                            m,
                            weights_q,
                            masses[item],
                            n,
                            minima[0],
                            minima[1],
                            rules,
                        )
                out[g, x] = normalise(emd, query.complexity, complexities[item], rules.form)
    return out


@njit(cache=True, nogil=True)
def gather_items(weights: Any, points: Any, items: IntArray) -> tuple[FloatArray, FloatArray]:
    """Weights (n, k) and points (n, d, k) of some items in double precision."""
    k_q, dims = points.shape[1], points.shape[2]
    some_weights, some_points = np.empty((len(items), k_q)), np.empty((len(items), dims, k_q))
    for n in range(len(items)):
        group, lane = items[n] // LANES, items[n] % LANES
        for j in range(k_q):
            some_weights[n, j] = weights[group, j, lane]
            for k in range(dims):
                some_points[n, k, j] = points[group, j, k, lane]
    return some_weights, some_points
