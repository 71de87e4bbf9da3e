"""Ground costs, relaxed lower bounds and exact distances of many pairs of signatures, in parallel.

Results do not depend on the number of threads: each pair is computed by one thread, in one order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from depthprint._kernels.transport import OPTIMAL, make_scratch, solve_transport

__all__ = ["PairRules", "Side", "difference_tasks", "ground_costs", "pair_distances", "relaxed_bounds"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

_ROUNDING = 1.0 + 1e-12  # a bound computed in floating point may exceed the distance by its rounding
_BLOCK = 64


class PairRules(NamedTuple):
    """How a pair of signatures is compared; codes as in `depthprint.emd`."""

    position_dims: int
    period: float  # 0: not circular
    cap: float
    surplus_cost: float
    balance: bool
    divide: bool
    form: int  # 0 EMD, 1 joint, 2 information, 3 steinhaus


class Side(NamedTuple):
    """Signatures as the kernels take them: points are (n, k, d) on the left side, (n, d, k) on the right."""

    weights: FloatArray  # (n, k)
    points: FloatArray
    counts: IntArray  # (n,)
    masses: FloatArray  # (n,)
    complexity: FloatArray  # (n,)


@njit(cache=True, nogil=True)
def _circular(difference: float, period: float) -> float:
    turns: float = np.rint(difference / period)
    return difference - period * turns


@njit(cache=True, nogil=True)
def _add_squares(
    p: FloatArray, q: FloatArray, first: int, last: int, m: int, n: int, square: FloatArray
) -> None:
    """Add the squared differences of coordinates first..last-1 of p (k, d) and q (d, k) to square[:m, :n]."""
    for i in range(m):
        row = square[i]
        k = first
        while k + 4 <= last:  # four coordinates a pass over the row
            x0, x1, x2, x3 = p[i, k], p[i, k + 1], p[i, k + 2], p[i, k + 3]
            q0, q1, q2, q3 = q[k], q[k + 1], q[k + 2], q[k + 3]
            for j in range(n):
                t0, t1, t2, t3 = x0 - q0[j], x1 - q1[j], x2 - q2[j], x3 - q3[j]
                row[j] += (t0 * t0 + t1 * t1) + (t2 * t2 + t3 * t3)
            k += 4
        while k < last:
            x0 = p[i, k]
            q0 = q[k]
            for j in range(n):
                t0 = x0 - q0[j]
                row[j] += t0 * t0
            k += 1


@njit(cache=True, nogil=True)
def ground_costs(
    p: FloatArray, q: FloatArray, m: int, n: int, shift: FloatArray, rules: PairRules, cost: FloatArray
) -> None:
    """min(||p + shift - q||, cap) of p (k, d) against q (d, k) into cost[:m, :n]."""
    d = q.shape[0]
    appearance = d - rules.position_dims
    for i in range(m):
        for j in range(n):
            cost[i, j] = 0.0
    _add_squares(p, q, 0, appearance, m, n, cost)
    for i in range(m):
        row = cost[i]
        for k in range(rules.position_dims):
            x = p[i, appearance + k] + shift[k]
            other = q[appearance + k]
            if k == 0 and rules.period > 0.0:
                for j in range(n):
                    t = _circular(x - other[j], rules.period)
                    row[j] += t * t
            else:
                for j in range(n):
                    t = x - other[j]
                    row[j] += t * t
        for j in range(n):
            row[j] = min(np.sqrt(row[j]), rules.cap)


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
def _two_sided(
    left: Side, a: int, right: Side, b: int, minima_p: FloatArray, minima_q: FloatArray, rules: PairRules
) -> float:
    """Lower bound of the EMD from the least costs of rows and columns."""
    surplus = 0.0 if rules.balance else left.masses[a] - right.masses[b]
    bound_p = _one_sided(left.weights[a], minima_p, left.counts[a], max(surplus, 0.0), rules.surplus_cost)
    bound_q = _one_sided(right.weights[b], minima_q, right.counts[b], max(-surplus, 0.0), rules.surplus_cost)
    bound_p += max(-surplus, 0.0) * rules.surplus_cost
    bound_q += max(surplus, 0.0) * rules.surplus_cost
    bound: float = max(bound_p, bound_q)
    if rules.divide:
        bound /= min(left.masses[a], right.masses[b])
    return bound


@njit(cache=True, nogil=True)
def _normalise(emd: float, k_p: float, k_q: float, form: int) -> float:
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


@njit(cache=True, nogil=True)
def _pair(
    left: Side,
    a: int,
    right: Side,
    b: int,
    shift: FloatArray,
    above: float,
    rules: PairRules,
    ints: IntArray,
    icost: IntArray,
    cost: FloatArray,
    minima: FloatArray,
) -> tuple[float, int, bool]:
    """(distance, status, solved): inf and not solved where the relaxed bound is over ``above``."""
    if left.masses[a] <= 0.0 or right.masses[b] <= 0.0:
        k_p, k_q = left.complexity[a], right.complexity[b]
        return _normalise(k_p + k_q, k_p, k_q, rules.form), OPTIMAL, False
    m, n = left.counts[a], right.counts[b]
    ground_costs(left.points[a], right.points[b], m, n, shift, rules, cost)
    if above < np.inf:
        for j in range(n):
            minima[1, j] = np.inf
        for i in range(m):
            least = np.inf
            for j in range(n):
                c = cost[i, j]
                least = min(least, c)
                minima[1, j] = min(minima[1, j], c)
            minima[0, i] = least
        bound = _two_sided(left, a, right, b, minima[0], minima[1], rules)
        if _normalise(bound, left.complexity[a], right.complexity[b], rules.form) > above * _ROUNDING:
            return np.inf, OPTIMAL, False
    work, status, _, _, _ = solve_transport(
        left.weights[a], right.weights[b], cost, m, n, rules.surplus_cost, rules.balance, ints, icost
    )
    if rules.divide:
        work /= min(left.masses[a], right.masses[b])
    return _normalise(work, left.complexity[a], right.complexity[b], rules.form), status, True


@njit(cache=True, parallel=True)
def difference_tasks(
    left: Side,
    right: Side,
    tasks: IntArray,
    shifts: FloatArray,
    below: float,
    rules: PairRules,
    out: FloatArray,
) -> IntArray:
    """out[i, j] of tasks (i, j_first, j_last): least distance over the shifts, inf where over ``below``."""
    status = np.zeros(len(tasks), np.int64)
    k_p, k_q = left.weights.shape[1], right.weights.shape[1]
    for t in prange(len(tasks)):
        ints, icost = make_scratch(k_p, k_q)
        cost = np.empty((k_p, k_q))
        minima = np.empty((2, max(k_p, k_q)))
        i = tasks[t, 0]
        for j in range(tasks[t, 1], tasks[t, 2]):
            best = np.inf
            for s in range(len(shifts)):
                value, code, _ = _pair(
                    left, i, right, j, shifts[s], min(best, below), rules, ints, icost, cost, minima
                )
                if code != OPTIMAL:
                    status[t] = code
                best = min(best, value)
            out[i, j] = best if best <= below else np.inf
    return status


@njit(cache=True, parallel=True)
def pair_distances(
    left: Side, right: Side, candidates: IntArray, chosen: IntArray, shifts: FloatArray, rules: PairRules
) -> tuple[FloatArray, IntArray, IntArray]:
    """Exact distances of left[0] to right[candidates] at shifts[chosen]: (distance, status, solved)."""
    count = len(candidates)
    distances = np.empty(count)
    status = np.zeros(count, np.int64)
    solved = np.zeros(count, np.int64)
    k_p, k_q = left.weights.shape[1], right.weights.shape[1]
    for t in prange(count):
        ints, icost = make_scratch(k_p, k_q)
        cost = np.empty((k_p, k_q))
        minima = np.empty((2, max(k_p, k_q)))
        value, code, was_solved = _pair(
            left, 0, right, candidates[t], shifts[chosen[t]], np.inf, rules, ints, icost, cost, minima
        )
        distances[t] = value
        status[t] = code
        solved[t] = 1 if was_solved else 0
    return distances, status, solved


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
                out[b] = _normalise(k_left + k_right, k_left, k_right, rules.form)
                continue
            base[:m, :n] = 0.0
            appearance = right.points.shape[1] - rules.position_dims
            _add_squares(left.points[0], right.points[b], 0, appearance, m, n, base)
            for s in range(len(shifts)):
                _least_costs(
                    left.points[0], right.points[b], m, n, shifts[s], rules, base, line, bits, minima
                )
                bound = _two_sided(left, 0, right, b, minima[0], minima[1], rules)
                out[b, s] = _normalise(bound, k_left, k_right, rules.form)
    return out


@njit(cache=True, nogil=True)
def _least_costs(
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
                    t = _circular(x - other[j], rules.period)
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
