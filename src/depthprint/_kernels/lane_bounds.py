"""Stored items as the sweeps take them, and bounds of LANES distances from least costs of rows and columns."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.ground import PairRules
from depthprint._kernels.relaxation import normalise, relaxed_work
from depthprint._kernels.split_points import join_item

__all__ = ["Items", "copy_points", "copy_weights", "gather_items", "lane_bounds"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]
ByteArray = npt.NDArray[np.uint8]
Float32Array = npt.NDArray[np.float32]


class Items(NamedTuple):
    """Signatures of an index, one after the other; points and weights are float32 or float64.

    Points are as `depthprint._kernels.split_points` has them, or (n, d, k) where rests (n, d, k, 0) are empty.
    """

    codes: ByteArray  # (groups, k, quads, LANES, 4)
    rest: ByteArray  # (n, d, k, 3)
    scales: Float32Array  # (n,)
    errors: Float32Array  # (n,)
    points: Any
    weights: Any  # (n, k), or (n, 0) where all clusters have one weight
    common_weight: float
    counts: IntArray  # (n,)
    masses: FloatArray  # (n,)
    complexity: FloatArray  # (n,)


@njit(cache=True, nogil=True)
def copy_weights(items: Items, item: int, out: FloatArray) -> None:
    """Weights (k,) of an item, 0 beyond its clusters."""
    for j in range(len(out)):
        if j >= items.counts[item]:
            out[j] = 0.0
        elif items.weights.shape[1] == 0:
            out[j] = items.common_weight
        else:
            out[j] = items.weights[item, j]


@njit(cache=True, nogil=True)
def copy_points(items: Items, item: int, out: FloatArray) -> None:
    """Points (d, k) of an item, 0 beyond its clusters."""
    if items.rest.shape[3] == 0:
        out[:] = items.points[item]
    else:
        join_item(items.codes, items.rest, items.scales, item, items.counts[item], out)


@njit(cache=True, nogil=True)
def gather_items(items: Items, chosen: IntArray) -> tuple[FloatArray, FloatArray]:
    """Weights (n, k) and points (n, d, k) of some items in double precision."""
    dims, k_q = items.rest.shape[1], items.rest.shape[2]
    weights, points = np.empty((len(chosen), k_q)), np.empty((len(chosen), dims, k_q))
    for n in range(len(chosen)):
        copy_weights(items, chosen[n], weights[n])
        copy_points(items, chosen[n], points[n])
    return weights, points


@njit(cache=True, nogil=True)
def lane_bounds(
    query_weights: FloatArray,
    query_mass: float,
    query_complexity: float,
    items: Items,
    chosen: IntArray,
    from_query: FloatArray,
    from_item: FloatArray,
    rows: Float32Array,
    columns: Float32Array,
    minima: FloatArray,
    weights_q: FloatArray,
    rules: PairRules,
    out: FloatArray,
) -> None:
    """Lower bounds of the distances to the ``chosen`` items, at most LANES of them, into out[:len(chosen)].

    rows (m, LANES), columns (k, LANES): least costs; from_query, from_item (LANES,): their weighted sums, which
    are the work where masses are equal. minima (2, >= m and k) and weights_q (k,) are scratch.
    """
    for x in range(len(chosen)):
        item = chosen[x]
        emd = query_complexity + items.complexity[item]
        if query_mass > 0.0 and items.masses[item] > 0.0:
            if rules.balance or query_mass == items.masses[item]:
                emd = max(from_query[x], from_item[x])
                if rules.divide:
                    emd /= min(query_mass, items.masses[item])
            else:
                m, n = len(query_weights), items.counts[item]
                for i in range(m):
                    minima[0, i] = rows[i, x]
                for j in range(n):
                    minima[1, j] = columns[j, x]
                copy_weights(items, item, weights_q)
                emd = relaxed_work(
                    query_weights, query_mass, m, weights_q, items.masses[item], n, minima[0], minima[1], rules
                )  # fmt: skip
        out[x] = normalise(emd, query_complexity, items.complexity[item], rules.form)
