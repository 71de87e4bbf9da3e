"""Relaxed bounds in float32 from the first coordinates of the appearances, many items side by side.

Items lie side by side in the vector registers: column j of item l is element j * lanes + l, so that the loops
over elements are long and the least of a row is taken in all lanes at once. ``slack`` and ``shrink`` are more
than the rounding of float32, so what is returned is a lower bound of the exact distance.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from depthprint._kernels.ground import PairRules
from depthprint._kernels.relaxation import normalise, relaxed_work

__all__ = ["reduced_bounds"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

_LANES = 32
_FAR = np.float32(3e38)


@njit(cache=True, nogil=True)
def _lay_side_by_side(
    points: Any, counts: IntArray, items: IntArray, q: Float32Array, far: Float32Array
) -> int:
    """First coordinates of the items into q, 0 or _FAR into ``far`` for columns there are or not; widest count."""
    widest = 0
    for x in range(len(items)):
        widest = max(widest, counts[items[x]])
    for c in range(widest * _LANES):
        far[c] = _FAR
    for x in range(len(items)):
        item = items[x]
        for j in range(counts[item]):
            far[j * _LANES + x] = np.float32(0.0)
        for k in range(len(q)):
            for j in range(counts[item]):
                q[k, j * _LANES + x] = points[item, k, j]
    return widest


@njit(cache=True, nogil=True)
def _add_coordinates(p: Float32Array, q: Float32Array, length: int, row: Float32Array) -> None:
    """Add the squared differences of point p and all columns of q to row[:length]."""
    k = 0
    while k + 4 <= len(p):  # four coordinates a pass over the row
        x0, x1, x2, x3 = p[k], p[k + 1], p[k + 2], p[k + 3]
        q0, q1, q2, q3 = q[k], q[k + 1], q[k + 2], q[k + 3]
        for c in range(length):
            t0, t1, t2, t3 = x0 - q0[c], x1 - q1[c], x2 - q2[c], x3 - q3[c]
            row[c] += (t0 * t0 + t1 * t1) + (t2 * t2 + t3 * t3)
        k += 4
    while k < len(p):
        x0, q0 = p[k], q[k]
        for c in range(length):
            t0 = x0 - q0[c]
            row[c] += t0 * t0
        k += 1


@njit(cache=True, nogil=True)
def _take_minima(row: Float32Array, length: int, columns: Float32Array, least: Any) -> None:
    """Least of each lane of the row into ``least``, and of each column so far into ``columns``."""
    for c in range(length):
        columns[c] = row[c] if row[c] < columns[c] else columns[c]
    # squares are >= 0, so their bits order as they do: an integer minimum is taken several at a time
    bits = row.view(np.int32)
    for x in range(_LANES):
        least[x] = bits[x]
    for start in range(_LANES, length, _LANES):
        for x in range(_LANES):
            least[x] = min(least[x], bits[start + x])


@njit(cache=True, parallel=True)
def reduced_bounds(
    appearance: Float32Array,
    weights_p: FloatArray,
    mass_p: float,
    complexity_p: float,
    weights: Any,
    points: Any,
    counts: IntArray,
    masses: FloatArray,
    complexities: FloatArray,
    items: IntArray,
    slack: float,
    rules: PairRules,
) -> FloatArray:
    """(len(items),) bounds of the distances of a query to ``items`` from the first coordinates.

    appearance (m, a): those coordinates of the query; points (n, d, k) and weights (n, k) of the stored items
    may be float32 or float64.
    """
    out = np.empty(len(items))
    m, dims = appearance.shape
    k_q = points.shape[2]
    shrink = 1.0 - 1.2e-7 * (dims + 16)
    tasks = (len(items) + _LANES - 1) // _LANES
    for task in prange(tasks):
        members = items[task * _LANES : min(len(items), (task + 1) * _LANES)]
        q = np.zeros((dims, k_q * _LANES), np.float32)
        far, row = np.empty(k_q * _LANES, np.float32), np.empty(k_q * _LANES, np.float32)
        columns = np.full(k_q * _LANES, _FAR)
        rows = np.empty((m, _LANES), np.int32)
        length = _lay_side_by_side(points, counts, members, q, far) * _LANES
        for i in range(m if length else 0):
            row[:length] = far[:length]
            _add_coordinates(appearance[i], q, length, row)
            _take_minima(row, length, columns, rows[i])
        squares = rows.view(np.float32)
        minima = np.empty((2, max(m, k_q)))
        weights_q = np.empty(k_q)
        for x in range(len(members)):
            item = members[x]
            n = counts[item]
            emd = complexity_p + complexities[item]
            if mass_p > 0.0 and masses[item] > 0.0:
                for i in range(m):
                    least = np.sqrt(np.float64(squares[i, x])) * shrink - slack
                    minima[0, i] = min(max(least, 0.0), rules.cap)
                for j in range(n):
                    least = np.sqrt(np.float64(columns[j * _LANES + x])) * shrink - slack
                    minima[1, j] = min(max(least, 0.0), rules.cap)
                    weights_q[j] = weights[item, j]
                emd = relaxed_work(
                    weights_p, mass_p, m, weights_q, masses[item], n, minima[0], minima[1], rules
                )
            out[task * _LANES + x] = normalise(emd, complexity_p, complexities[item], rules.form)
    return out
