"""Relaxed bounds in float32, refined a few coordinates at a time and given up as soon as they are too large.

Coordinates not looked at yet enter by the difference of their norms. ``slack`` and ``shrink`` are more than
the rounding of float32, so what is returned is a lower bound of the exact distance.
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

_ITEMS_PER_TASK = 32
_WIDTH = 16  # columns are padded to whole vectors
_FIRST = 8  # appearance coordinates before the first look; each look doubles them
_FAR = np.float32(3e38)


@njit(cache=True, nogil=True)
def _add_coordinates(
    p: Float32Array, q: Float32Array, first: int, last: int, m: int, width: int, square: Float32Array
) -> None:
    for i in range(m):
        row = square[i]
        k = first
        while k + 4 <= last:  # four coordinates a pass over the row
            x0, x1, x2, x3 = p[i, k], p[i, k + 1], p[i, k + 2], p[i, k + 3]
            q0, q1, q2, q3 = q[k], q[k + 1], q[k + 2], q[k + 3]
            for j in range(width):
                t0, t1, t2, t3 = x0 - q0[j], x1 - q1[j], x2 - q2[j], x3 - q3[j]
                row[j] += (t0 * t0 + t1 * t1) + (t2 * t2 + t3 * t3)
            k += 4
        while k < last:
            x0, q0 = p[i, k], q[k]
            for j in range(width):
                t0 = x0 - q0[j]
                row[j] += t0 * t0
            k += 1


@njit(cache=True, nogil=True)
def _add_positions(
    low: Float32Array,
    high: Float32Array,
    q: Float32Array,
    first: int,
    m: int,
    width: int,
    square: Float32Array,
) -> None:
    """Squared gaps of the positions, wherever between ``low`` and ``high`` a shift may put them."""
    for i in range(m):
        row = square[i]
        for k in range(low.shape[1]):
            a, b, other = low[i, k], high[i, k], q[first + k]
            for j in range(width):
                x = other[j]
                t = a - x if x < a else (x - b if x > b else np.float32(0.0))
                row[j] += t * t


@njit(cache=True, nogil=True)
def _minima(
    square: Float32Array,
    rest_p: Float32Array,
    rest_q: Float32Array,
    m: int,
    n: int,
    width: int,
    line: Float32Array,
    columns: Float32Array,
    slack: float,
    shrink: float,
    cap: float,
    minima: FloatArray,
) -> None:
    bits = line.view(np.int32)
    for j in range(width):
        columns[j] = _FAR
    for i in range(m):
        r, row = rest_p[i], square[i]
        for j in range(width):
            t = r - rest_q[j]
            line[j] = row[j] + t * t
        # squares are >= 0, so their bits order as they do: an integer minimum is taken several at a time
        least = np.int32(0x7F7FFFFF)
        for j in range(width):
            least = min(least, bits[j])
            columns[j] = min(columns[j], line[j])
        bits[0] = least
        minima[0, i] = min(max(np.sqrt(np.float64(line[0])) * shrink - slack, 0.0), cap)
    for j in range(n):
        minima[1, j] = min(max(np.sqrt(np.float64(columns[j])) * shrink - slack, 0.0), cap)


@njit(cache=True, nogil=True)
def _norms_of_rest(appearance: Float32Array) -> Float32Array:
    """(looks, m) norms of the coordinates that a look has not added yet."""
    m, dims = appearance.shape
    rests = np.zeros((64, m), np.float32)
    done = look = 0
    while done < dims:
        done = min(max(2 * done, _FIRST), dims)
        for i in range(m):
            total = np.float32(0.0)
            for k in range(done, dims):
                total += appearance[i, k] * appearance[i, k]
            rests[look, i] = np.sqrt(total)
        look += 1
    return rests


@njit(cache=True, parallel=True)
def reduced_bounds(
    appearance: Float32Array,
    low: Float32Array,
    high: Float32Array,
    weights_p: FloatArray,
    mass_p: float,
    complexity_p: float,
    weights: Any,
    points: Any,
    counts: IntArray,
    masses: FloatArray,
    complexities: FloatArray,
    items: IntArray,
    above: FloatArray,
    slack: float,
    rules: PairRules,
) -> FloatArray:
    """(len(items),) bounds of the distances of a query to ``items``; work on an item ends once over ``above``.

    appearance (m, a), low and high (m, e): the query's appearance and where shifts may put its first e
    positions; points (n, d, k) and weights (n, k) of the stored items may be float32 or float64.
    """
    out = np.empty(len(items))
    m, dims = appearance.shape
    k_q = points.shape[2]
    extent = low.shape[1]
    size = (k_q + _WIDTH - 1) // _WIDTH * _WIDTH
    rests = _norms_of_rest(appearance)
    shrink = 1.0 - 1.2e-7 * (points.shape[1] + 16)
    tasks = (len(items) + _ITEMS_PER_TASK - 1) // _ITEMS_PER_TASK
    for task in prange(tasks):
        square = np.empty((m, size), np.float32)
        q = np.empty((dims + extent, size), np.float32)
        rest_q = np.empty(size, np.float32)
        line, columns = np.empty(size, np.float32), np.empty(size, np.float32)
        minima = np.empty((2, max(m, k_q)))
        weights_q = np.empty(k_q)
        for x in range(task * _ITEMS_PER_TASK, min(len(items), (task + 1) * _ITEMS_PER_TASK)):
            item = items[x]
            n = counts[item]
            complexity_q = complexities[item]
            if mass_p <= 0.0 or masses[item] <= 0.0:
                out[x] = normalise(complexity_p + complexity_q, complexity_p, complexity_q, rules.form)
                continue
            width = (n + _WIDTH - 1) // _WIDTH * _WIDTH
            stored = points[item]
            for k in range(dims + extent):
                target, source = q[k], stored[k]
                for j in range(n):
                    target[j] = source[j]
                for j in range(n, width):
                    target[j] = np.float32(0.0)
            for j in range(n):
                weights_q[j] = weights[item, j]
            for i in range(m):
                for j in range(n):
                    square[i, j] = np.float32(0.0)
                for j in range(n, width):
                    square[i, j] = _FAR
            _add_positions(low, high, q, dims, m, width, square)
            done = look = 0
            bound = 0.0
            while done < dims or done == 0:
                following = min(max(2 * done, _FIRST), dims)
                _add_coordinates(appearance, q, done, following, m, width, square)
                for j in range(width):
                    rest_q[j] = np.float32(0.0)
                for k in range(following, dims):
                    source_q = q[k]
                    for j in range(width):
                        rest_q[j] += source_q[j] * source_q[j]
                for j in range(width):
                    rest_q[j] = np.sqrt(rest_q[j])
                _minima(
                    square, rests[look], rest_q, m, n, width, line, columns, slack, shrink, rules.cap, minima
                )
                work = relaxed_work(
                    weights_p, mass_p, m, weights_q, masses[item], n, minima[0], minima[1], rules
                )
                bound = normalise(work, complexity_p, complexity_q, rules.form)
                done, look = following, look + 1
                if bound > above[x] or dims == 0:
                    break
            out[x] = bound
    return out
