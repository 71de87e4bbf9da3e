"""Relaxed bounds in float32 of some items of an index, LANES of them side by side.

Least squared distances come from products: |p - q|^2 = |p|^2 + |q|^2 - 2 p q. What float32 may have rounded,
in the products and in the points themselves, is taken off, so that what is returned is a lower bound.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from depthprint._kernels.ground import PairRules
from depthprint._kernels.lane_bounds import Items, copy_points, copy_weights, lane_bounds
from depthprint._kernels.tiles import LANES, TILE_ROWS, load_column, meet_column, weigh_least

__all__ = ["QueryTiles", "sweep_bounds", "tile_query"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

_FAR = np.float32(-1e38)
_FARTHEST = np.float32(-3e38)
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
def sweep_bounds(query: QueryTiles, items: Items, chosen: IntArray, rules: PairRules) -> FloatArray:
    """Lower bounds (len(chosen),) of the distances of a query to some items, whose first coordinates it has."""
    out = np.empty(len(chosen))
    tiles, dims = query.halves.shape[0], query.points.shape[1]
    m, k_q = len(query.weights), items.rest.shape[2]
    squared, slack = np.float32(query.slack_squared), np.float32(query.slack)
    shrink, most = np.float32(1.0 - 5e-7), np.float32(rules.cap * (1.0 - 1e-7))
    for group in prange((len(chosen) + LANES - 1) // LANES):
        some = chosen[group * LANES : (group + 1) * LANES]
        points = np.zeros((1, k_q, dims, LANES), np.float32)
        weights = np.zeros((k_q, LANES))
        q, q_halves = np.empty((dims, LANES), np.float32), np.empty(LANES, np.float32)
        tile_rows = np.full((tiles, TILE_ROWS, LANES), _FARTHEST)
        rows, columns = tile_rows.reshape(-1, LANES), np.full((k_q, LANES), _FARTHEST)
        from_query, from_item = np.empty(LANES), np.empty(LANES)
        minima, weights_q = np.empty((2, max(m, k_q))), np.empty(k_q)
        whole = np.empty(items.rest.shape[1:3])
        widest = 0
        for x in range(len(some)):
            widest = max(widest, items.counts[some[x]])
            copy_weights(items, some[x], weights_q)
            weights[:, x] = weights_q
            copy_points(items, some[x], whole)
            for k in range(dims):
                for j in range(items.counts[some[x]]):
                    points[0, j, k, x] = whole[k, j]
        for j in range(widest):
            load_column(points, 0, j, q, q_halves)
            for x in range(len(some)):
                if j >= items.counts[some[x]]:
                    q_halves[x] = _FAR
            for tile in range(tiles):
                meet_column(query.points, query.halves, tile, q, q_halves, dims, tile_rows, columns, j)
        weigh_least(rows, m, query.weights, from_query, squared, slack, shrink, most)
        weigh_least(columns, widest, weights, from_item, squared, slack, shrink, most)
        lane_bounds(
            query.weights, query.mass, query.complexity, items, some, from_query, from_item, rows, columns,
            minima, weights_q, rules, out[group * LANES :],
        )  # fmt: skip
    return out
