"""Which of some items are among the k nearest: relaxed bounds shift by shift, then exact distances, one by one."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.ground import PairRules, Side, add_squares
from depthprint._kernels.pairs import ROUNDING, pair_distance
from depthprint._kernels.relaxation import least_costs, normalise, relaxed_work
from depthprint._kernels.transport import OPTIMAL, make_scratch

__all__ = ["StreamPairs", "decide"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]


class StreamPairs(NamedTuple):
    """One stream of a query and of the items that it meets."""

    left: Side
    right: Side
    shifts: FloatArray  # (shifts, position_dims)
    weight: float
    rules: PairRules


@njit(cache=True, nogil=True)
def decide(
    streams: Any,
    bounds: FloatArray,
    swept: FloatArray,
    nearest: FloatArray,
    distances: FloatArray,
    shifts: IntArray,
) -> tuple[int, int, int]:
    """(EMDs solved, bounds computed, status) of items by rising ``bounds`` (n,), for streams of `StreamPairs`.

    distances (n,), shifts (n,): least distance over the shifts and the first shift that has it, of each item that
    may be among the nearest; else they stay as they are. nearest (k,): smallest distances so far, rising. swept
    (streams, n): parts of the bounds if these are of the only shift there is, else (streams, 0).
    """
    n_shifts = len(streams[0].shifts)
    k_p = k_q = 1
    for stream in streams:
        k_p, k_q = max(k_p, stream.left.weights.shape[1]), max(k_q, stream.right.weights.shape[1])
    ints, icost = make_scratch(k_p, k_q)
    cost, minima, line = np.empty((k_p, k_q)), np.empty((2, max(k_p, k_q))), np.empty(k_q)
    parts, sums = np.empty((len(streams), n_shifts)), np.empty(n_shifts)
    order: IntArray = np.zeros(1, np.int64)
    solved = bounded = 0
    status = OPTIMAL
    for t in range(len(bounds)):
        if bounds[t] > nearest[-1] * ROUNDING:
            break
        if swept.shape[1] > 0:
            parts[:, 0] = swept[:, t]
            sums[0] = bounds[t]
        else:
            sums[:] = 0.0
            for s in range(len(streams)):
                _relaxed(streams[s], t, cost, line, minima, parts[s])
                sums += parts[s]
                bounded += n_shifts
            if n_shifts > 1:
                order = np.argsort(sums, kind="mergesort")
        best, best_shift = np.inf, np.int64(-1)
        for shift in order:
            limit = min(nearest[-1], best) * ROUNDING
            if sums[shift] > limit:
                break
            total, rest = 0.0, sums[shift]
            for s in range(len(streams)):
                stream = streams[s]
                rest = max(rest - parts[s, shift], 0.0)
                spare = (limit * ROUNDING - total - rest) / stream.weight
                value, code, was_solved = pair_distance(
                    stream.left, 0, stream.right, t, stream.shifts[shift], spare, stream.rules, ints, icost,
                    cost, minima,
                )  # fmt: skip
                if code != OPTIMAL:
                    status = code
                solved += was_solved
                total += stream.weight * value
                if total + rest > limit * ROUNDING:
                    total = np.inf
                    break
            if total < best or (total == best and shift < best_shift):
                best, best_shift = total, shift
        if best < np.inf:
            distances[t], shifts[t] = best, best_shift
            place = len(nearest) - 1
            if best < nearest[place]:
                while place > 0 and nearest[place - 1] > best:
                    nearest[place] = nearest[place - 1]
                    place -= 1
                nearest[place] = best
    return solved, bounded, status


@njit(cache=True, nogil=True)
def _relaxed(
    stream: StreamPairs, t: int, cost: FloatArray, line: FloatArray, minima: FloatArray, out: FloatArray
) -> None:
    """Weighted relaxed bounds (shifts,) of the distance to item t."""
    left, right, rules = stream.left, stream.right, stream.rules
    m, n = left.counts[0], right.counts[t]
    k_left, k_right = left.complexity[0], right.complexity[t]
    if left.masses[0] <= 0.0 or right.masses[t] <= 0.0:
        out[:] = stream.weight * normalise(k_left + k_right, k_left, k_right, rules.form)
        return
    cost[:m, :n] = 0.0
    add_squares(left.points[0], right.points[t], 0, right.points.shape[1] - rules.position_dims, m, n, cost)
    for shift in range(len(out)):
        least_costs(
            left.points[0], right.points[t], m, n, stream.shifts[shift], rules, cost, line,
            line.view(np.int64), minima,
        )  # fmt: skip
        bound = relaxed_work(
            left.weights[0], left.masses[0], m, right.weights[t], right.masses[t], n, minima[0], minima[1],
            rules,
        )  # fmt: skip
        out[shift] = stream.weight * normalise(bound, k_left, k_right, rules.form)
