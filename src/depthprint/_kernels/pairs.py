"""Exact distances of many pairs of signatures, in parallel.

Results do not depend on the number of threads: each pair is computed by one thread, in one order.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from depthprint._kernels.dual_bound import work_limit
from depthprint._kernels.ground import PairRules, Side, ground_costs
from depthprint._kernels.relaxation import normalise, reduced_work
from depthprint._kernels.transport import ABANDONED, OPTIMAL, make_scratch, solve_transport

__all__ = [
    "ROUNDING",
    "difference_run",
    "difference_tasks",
    "pair_distance",
    "pair_distances",
    "solve_many",
    "solve_run",
]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

_PAIRS_PER_TASK = 4
ROUNDING = 1.0 + 1e-12  # a bound computed in floating point may exceed the distance by its rounding


@njit(cache=True, nogil=True)
def pair_distance(
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
    """(distance, status, solved): inf and not solved where a bound is over ``above``."""
    if left.masses[a] <= 0.0 or right.masses[b] <= 0.0:
        k_p, k_q = left.complexity[a], right.complexity[b]
        return normalise(k_p + k_q, k_p, k_q, rules.form), OPTIMAL, False
    m, n = left.counts[a], right.counts[b]
    ground_costs(left.points[a], right.points[b], m, n, shift, rules, cost)
    if above < np.inf:
        bound = reduced_work(left, a, right, b, cost, m, n, minima, rules)
        if normalise(bound, left.complexity[a], right.complexity[b], rules.form) > above * ROUNDING:
            return np.inf, OPTIMAL, False
    limit = np.inf
    if above < np.inf:
        limit = work_limit(above, left.complexity[a], right.complexity[b], rules.form)
        if rules.divide:
            limit *= min(left.masses[a], right.masses[b])
    work, status, _, _, _ = solve_transport(
        left.weights[a], right.weights[b], cost, m, n, rules.surplus_cost, rules.balance, limit, ints, icost
    )
    if status == ABANDONED:
        return np.inf, OPTIMAL, False
    if rules.divide:
        work /= min(left.masses[a], right.masses[b])
    return normalise(work, left.complexity[a], right.complexity[b], rules.form), status, True


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
    for t in prange(len(tasks)):
        status[t] = difference_run(left, right, tasks[t : t + 1], shifts, below, rules, out)
    return status


@njit(cache=True, nogil=True)
def difference_run(
    left: Side,
    right: Side,
    tasks: IntArray,
    shifts: FloatArray,
    below: float,
    rules: PairRules,
    out: FloatArray,
) -> int:
    """``difference_tasks`` on the calling thread; the last status that is not optimal, if any."""
    status = OPTIMAL
    k_p, k_q = left.weights.shape[1], right.weights.shape[1]
    ints, icost = make_scratch(k_p, k_q)
    cost = np.empty((k_p, k_q))
    minima = np.empty((2, max(k_p, k_q)))
    for t in range(len(tasks)):
        i = tasks[t, 0]
        for j in range(tasks[t, 1], tasks[t, 2]):
            best = np.inf
            for s in range(len(shifts)):
                value, code, _ = pair_distance(
                    left, i, right, j, shifts[s], min(best, below), rules, ints, icost, cost, minima
                )
                if code != OPTIMAL:
                    status = code
                best = min(best, value)
            out[i, j] = best if best <= below else np.inf
    return status


@njit(cache=True, parallel=True)
def pair_distances(
    left: Side,
    right: Side,
    chosen: IntArray,
    above: FloatArray,
    shifts: FloatArray,
    rules: PairRules,
) -> tuple[FloatArray, IntArray, IntArray]:
    """Exact distances of left[0] to right[t] at shifts[chosen[t]]: (distance, status, solved).

    inf and not solved where a bound shows that a distance is over its ``above``.
    """
    count = len(right.counts)
    distances = np.empty(count)
    status = np.zeros(count, np.int64)
    solved = np.zeros(count, np.int64)
    tasks = (count + _PAIRS_PER_TASK - 1) // _PAIRS_PER_TASK
    for task in prange(tasks):
        first, last = task * _PAIRS_PER_TASK, min(count, (task + 1) * _PAIRS_PER_TASK)
        solve_run(left, right, first, last, chosen, above, shifts, rules, distances, status, solved)
    return distances, status, solved


@njit(cache=True, nogil=True)
def solve_run(
    left: Side,
    right: Side,
    first: int,
    last: int,
    chosen: IntArray,
    above: FloatArray,
    shifts: FloatArray,
    rules: PairRules,
    distances: FloatArray,
    status: IntArray,
    solved: IntArray,
) -> None:
    """Pairs first..last-1 of right with the only one of left, or with those of left, on the calling thread."""
    k_p, k_q = left.weights.shape[1], right.weights.shape[1]
    ints, icost = make_scratch(k_p, k_q)
    cost = np.empty((k_p, k_q))
    minima = np.empty((2, max(k_p, k_q)))
    alone = len(left.counts) == 1
    for t in range(first, last):
        value, code, was_solved = pair_distance(
            left, 0 if alone else t, right, t, shifts[chosen[t]], above[t], rules, ints, icost, cost, minima
        )
        distances[t] = value
        status[t] = code
        solved[t] = 1 if was_solved else 0


@njit(cache=True, nogil=True)
def solve_many(
    weights_p: FloatArray, weights_q: FloatArray, costs: FloatArray, surplus_cost: float, balance: bool
) -> tuple[FloatArray, IntArray]:
    """(work, status) of problems with weights (n, m), (n, k) and costs (n, m, k), one after the other."""
    count, m, k = costs.shape
    works, status = np.empty(count), np.zeros(count, np.int64)
    ints, icost = make_scratch(m, k)
    for x in range(count):
        works[x], status[x], _, _, _ = solve_transport(
            weights_p[x], weights_q[x], costs[x], m, k, surplus_cost, balance, np.inf, ints, icost
        )
    return works, status
