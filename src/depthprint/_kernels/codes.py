"""Points as 8-bit integers, and relaxed bounds from these alone for all items of an index.

Each item has a scale of its own, points being codes times scale, and the largest distance of a point from that.
A true distance is no less than that of the coded points less both distances. Dot products of codes are exact
in 32 bits; half norms are rounded down in units of the product of both scales, which makes a distance smaller.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from depthprint._kernels.code_tiles import CODE_ROWS, load_codes, meet_codes, start_rows
from depthprint._kernels.ground import PairRules
from depthprint._kernels.lane_bounds import Items, copy_weights, lane_bounds
from depthprint._kernels.tiles import LANES, weigh_least

__all__ = ["CodedQuery", "code_query", "quads_of", "sweep_codes"]

IntArray = npt.NDArray[np.int64]
Int32Array = npt.NDArray[np.int32]
FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

_MISSING = np.int32(-(1 << 29))
_LARGEST_RATIO = 1e20
_LARGEST_CODE = 127  # of a query
_LEAST_SCALE = 1e-30
_GROUPS_PER_TASK = 16
_UP, _DOWN = 1.0 + 1e-6, 1.0 - 1e-6  # more than a few roundings in float32


class CodedQuery(NamedTuple):
    """Codes of a query's points in tiles; those missing from the last one are far from everything."""

    points: Int32Array  # (tiles, quads, CODE_ROWS): four signed codes each
    squares: Float32Array  # (tiles * CODE_ROWS,): |codes|^2
    offsets: Int32Array  # (tiles * CODE_ROWS,): what 128 more in each code of an item adds to a product
    mask: Int32Array  # (quads,): bytes of an item's codes that are compared
    scale: float
    error: float  # largest distance of a point from its codes
    weights: FloatArray  # (m,)
    mass: float
    complexity: float


def quads_of(dims: int) -> int:
    """Lanes of 32 bits that a point takes."""
    return -(-dims // 4)


def code_query(
    points: FloatArray, weights: FloatArray, mass: float, complexity: float, dims: int
) -> CodedQuery:
    """Codes of points (m, first coordinates) that are to meet points of ``dims`` coordinates."""
    m, compared = points.shape
    tiles, quads = -(-m // CODE_ROWS), quads_of(dims)
    scale = max(float(np.abs(points).max(initial=0.0)) / _LARGEST_CODE, _LEAST_SCALE)
    codes = np.zeros((tiles * CODE_ROWS, 4 * quads), np.int8)
    codes[:m, :compared] = np.rint(points / scale)
    gaps = points - scale * codes[:m, :compared]
    mask = np.zeros(4 * quads, np.uint8)
    mask[:compared] = 255
    wide = codes.astype(np.int64)
    lanes = codes.view(np.int32).reshape(tiles, CODE_ROWS, quads)
    return CodedQuery(
        np.ascontiguousarray(lanes.transpose(0, 2, 1)),
        (wide**2).sum(axis=1).astype(np.float32),
        (128 * wide.sum(axis=1)).astype(np.int32),
        mask.view(np.int32),
        scale,
        float(np.sqrt((gaps**2).sum(axis=1)).max(initial=0.0)) * _UP,
        weights[:m],
        mass,
        complexity,
    )


@njit(cache=True, parallel=True)
def sweep_codes(
    query: CodedQuery,
    codes: Int32Array,
    items: Items,
    groups: IntArray,
    weight: float,
    rules: PairRules,
    out: FloatArray,
) -> None:
    """``weight`` times a bound of the distances to the items of some groups into out (len(groups), LANES).

    codes (groups, k, quads, LANES): those of the items, four a lane. Lanes beyond the last item get inf.
    """
    tiles, k_q, quads = len(query.points), codes.shape[1], codes.shape[2]
    m = len(query.weights)
    up_per_scale = 0.5 * _DOWN / query.scale
    cap, nothing = np.float32(rules.cap * (1.0 - 1e-7)), np.float32(0.0)
    for task in prange((len(groups) + _GROUPS_PER_TASK - 1) // _GROUPS_PER_TASK):
        q, q_start = np.empty((quads, LANES), np.int32), np.empty(LANES, np.int32)
        starts, tile_rows = (
            np.empty((tiles, CODE_ROWS, LANES), np.int32),
            np.empty((tiles, CODE_ROWS, LANES), np.int32),
        )
        flat_starts, rows = starts.reshape(-1, LANES), tile_rows.reshape(-1, LANES)
        columns, weights = np.empty((k_q, LANES), np.int32), np.ones((k_q, LANES))
        shrink, slack = np.ones(LANES, np.float32), np.zeros(LANES, np.float32)
        from_query, from_item, bounds = np.empty(LANES), np.empty(LANES), np.empty(LANES)
        up, down = np.ones(LANES, np.float32), np.ones(LANES, np.float32)
        minima, weights_q = np.empty((2, max(m, k_q))), np.empty(k_q)
        chosen = np.empty(LANES, np.int64)
        for g in range(task * _GROUPS_PER_TASK, min(len(groups), (task + 1) * _GROUPS_PER_TASK)):
            first = groups[g] * LANES
            present = min(LANES, len(items.counts) - first)
            widest, narrowest = 0, k_q
            for x in range(present):
                item = first + x
                chosen[x] = item
                scale = np.float64(items.scales[item])
                up[x] = min(up_per_scale * scale, _LARGEST_RATIO)
                down[x] = min(0.5 * _DOWN * query.scale / scale, _LARGEST_RATIO)
                shrink[x] = np.sqrt(scale * query.scale) * _DOWN
                slack[x] = (items.errors[item] + query.error) * _UP
                widest, narrowest = max(widest, items.counts[item]), min(narrowest, items.counts[item])
                if items.weights.shape[1] > 0:
                    copy_weights(items, item, weights_q)
                    weights[:, x] = weights_q
            rows[:] = 2 * _MISSING
            columns[:widest] = 2 * _MISSING
            flat_starts[m:] = _MISSING
            start_rows(query.squares, query.offsets, m, down, flat_starts)
            for j in range(widest):
                load_codes(codes, groups[g], j, query.mask, up, q, q_start)
                if j >= narrowest:
                    for x in range(present):
                        if j >= items.counts[first + x]:
                            q_start[x] = _MISSING
                for tile in range(tiles):
                    meet_codes(query.points, starts, tile, q, q_start, tile_rows, columns, j)
            for j in range(narrowest, widest):
                for x in range(present):
                    if j >= items.counts[first + x]:
                        columns[j, x] = 0  # at no distance, and so of no weight
            weigh_least(rows, m, query.weights, from_query, nothing, slack, shrink, cap)
            weigh_least(columns, widest, weights, from_item, nothing, slack, shrink, cap)
            if items.weights.shape[1] == 0:
                from_item *= items.common_weight
            lane_bounds(
                query.weights, query.mass, query.complexity, items, chosen[:present], from_query, from_item,
                rows.view(np.float32), columns.view(np.float32), minima, weights_q, rules, bounds,
            )  # fmt: skip
            for x in range(LANES):
                out[g, x] = weight * bounds[x] if x < present else np.inf
