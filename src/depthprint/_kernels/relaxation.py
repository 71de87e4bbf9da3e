"""Relaxed lower bounds of many distances: each cluster goes to its nearest, from either side."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from depthprint._kernels.ground import PairRules, Side, add_squares, circular

__all__ = ["normalise", "reduced_work", "relaxed_bounds", "relaxed_work"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

_BLOCK = 64
_SHRINK = 1.0 - 1e-13  # every term of a reduced bound is >= 0
_MASS_ROUNDING = 1e-15  # equal masses are equal sums of rounded weights


@njit(cache=True, nogil=True)
def _one_sided(weights: FloatArray, minima: FloatArray, k: int, surplus: float, surplus_cost: float) -> float:
    """Work if each cluster went to its nearest and the dearest gave the surplus; uses ``minima`` up."""
    bound = 0.0
    for i in range(k):
        bound += weights[i] * minima[i]
    while surplus > 0.0:
        dearest = -1
        for i in range(k):
            if weights[i] > 0.0 and minima[i] >= 0.0 and (dearest < 0 or minima[i] > minima[dearest]):
                dearest = i
        if dearest < 0:
            break
        amount = min(surplus, weights[dearest])
        bound += amount * (surplus_cost - minima[dearest])
        surplus -= amount
        minima[dearest] = -1.0
    return bound


@njit(cache=True, nogil=True)
def relaxed_work(
    weights_p: FloatArray,
    mass_p: float,
    m: int,
    weights_q: FloatArray,
    mass_q: float,
    n: int,
    minima_p: FloatArray,
    minima_q: FloatArray,
    rules: PairRules,
) -> float:
    """Lower bound of the EMD from the least costs of rows and columns, which are used up."""
    surplus = 0.0 if rules.balance else mass_p - mass_q
    bound_p = _one_sided(weights_p, minima_p, m, max(surplus, 0.0), rules.surplus_cost)
    bound_q = _one_sided(weights_q, minima_q, n, max(-surplus, 0.0), rules.surplus_cost)
    bound_p += max(-surplus, 0.0) * rules.surplus_cost
    bound_q += max(surplus, 0.0) * rules.surplus_cost
    bound: float = max(bound_p, bound_q)
    if rules.divide:
        bound /= min(mass_p, mass_q)
    return bound


@njit(cache=True, nogil=True)
def reduced_work(
    left: Side,
    a: int,
    right: Side,
    b: int,
    cost: FloatArray,
    m: int,
    n: int,
    minima: FloatArray,
    rules: PairRules,
) -> float:
    """Lower bound of the EMD of left[a] and right[b] at cost[:m, :n], less what rounding may have added.

    Where masses are equal, the least costs of the rows, then those of the columns after the rows' are taken off,
    and the other way round: duals that are feasible, as at the start of the Hungarian method.
    """
    weights_p, weights_q, rows, columns = left.weights[a], right.weights[b], minima[0], minima[1]
    for j in range(n):
        columns[j] = np.inf
    for i in range(m):
        least = np.inf
        for j in range(n):
            c = cost[i, j]
            least = min(least, c)
            columns[j] = min(columns[j], c)
        rows[i] = least
    if not rules.balance and left.masses[a] != right.masses[b]:
        fallback: float = relaxed_work(
            weights_p, left.masses[a], m, weights_q, right.masses[b], n, rows, columns, rules
        )
        return fallback
    from_columns: float = 0.0
    for j in range(n):
        from_columns += weights_q[j] * columns[j]
    for i in range(m):
        least = np.inf
        for j in range(n):
            least = min(least, cost[i, j] - columns[j])
        from_columns += weights_p[i] * least
    from_rows = 0.0
    for j in range(n):
        columns[j] = np.inf
    for i in range(m):
        from_rows += weights_p[i] * rows[i]
        for j in range(n):
            columns[j] = min(columns[j], cost[i, j] - rows[i])
    for j in range(n):
        from_rows += weights_q[j] * columns[j]
    bound: float = max(from_rows, from_columns) * _SHRINK - _MASS_ROUNDING * left.masses[a] * rules.cap
    if rules.divide:
        bound /= min(left.masses[a], right.masses[b])
    return bound


@njit(cache=True, nogil=True)
def normalise(emd: float, k_p: float, k_q: float, form: int) -> float:
    """Form of the distance; 1 (2 for `information`) is a theorem, so clipping there removes rounding only."""
    if form == 0:
        return emd
    larger = max(k_p, k_q)
    if larger <= 0.0:
        return 0.0
    if form == 1:
        return min((emd + abs(k_p - k_q)) / (2.0 * larger), 1.0)
    if form == 2:
        return min(emd / larger, 2.0)
    return min(2.0 * emd / (k_p + k_q + emd), 1.0)


@njit(cache=True, parallel=True)
def relaxed_bounds(left: Side, right: Side, count: int, shifts: FloatArray, rules: PairRules) -> FloatArray:
    """(count, shifts) lower bounds of the distance of left signature 0 to right[:count]."""
    out = np.empty((count, len(shifts)))
    k_p, k_q = left.weights.shape[1], right.weights.shape[1]
    m = left.counts[0]
    blocks = (count + _BLOCK - 1) // _BLOCK
    for block in prange(blocks):
        base = np.empty((k_p, k_q))
        minima = np.empty((2, max(k_p, k_q)))
        line = np.empty(k_q)
        bits = line.view(np.int64)
        for b in range(block * _BLOCK, min(count, (block + 1) * _BLOCK)):
            n = right.counts[b]
            k_left, k_right = left.complexity[0], right.complexity[b]
            if left.masses[0] <= 0.0 or right.masses[b] <= 0.0:
                out[b] = normalise(k_left + k_right, k_left, k_right, rules.form)
                continue
            base[:m, :n] = 0.0
            appearance = right.points.shape[1] - rules.position_dims
            add_squares(left.points[0], right.points[b], 0, appearance, m, n, base)
            for s in range(len(shifts)):
                least_costs(left.points[0], right.points[b], m, n, shifts[s], rules, base, line, bits, minima)
                bound = relaxed_work(
                    left.weights[0],
                    left.masses[0],
                    m,
                    right.weights[b],
                    right.masses[b],
                    n,
                    minima[0],
                    minima[1],
                    rules,
                )
                out[b, s] = normalise(bound, k_left, k_right, rules.form)
    return out


@njit(cache=True, nogil=True)
def least_costs(
    p: FloatArray,
    q: FloatArray,
    m: int,
    n: int,
    shift: FloatArray,
    rules: PairRules,
    base: FloatArray,
    line: FloatArray,
    bits: IntArray,
    minima: FloatArray,
) -> None:
    """Least cost of each row into minima[0], of each column into minima[1]; ``base``: appearance part."""
    appearance = q.shape[0] - rules.position_dims
    rows, columns = minima[0], minima[1]
    for j in range(n):
        columns[j] = np.inf
    for i in range(m):
        row = base[i]
        if rules.position_dims == 0:
            for j in range(n):
                line[j] = row[j]
        for k in range(rules.position_dims):
            x = p[i, appearance + k] + shift[k]
            other = q[appearance + k]
            if k > 0:
                for j in range(n):
                    t = x - other[j]
                    line[j] += t * t
            elif rules.period > 0.0:
                for j in range(n):
                    t = circular(x - other[j], rules.period)
                    line[j] = row[j] + t * t
            else:
                for j in range(n):
                    t = x - other[j]
                    line[j] = row[j] + t * t
        # squares are >= 0, so their bits order as they do: an integer minimum is taken several at a time
        least = np.int64(0x7FF0000000000000)
        for j in range(n):
            least = min(least, bits[j])
            columns[j] = min(columns[j], line[j])
        bits[0] = least
        rows[i] = line[0]
    for i in range(m):
        rows[i] = min(np.sqrt(rows[i]), rules.cap)
    for j in range(n):
        columns[j] = min(np.sqrt(columns[j]), rules.cap)
