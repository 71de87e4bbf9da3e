"""Signatures as the kernels take them, and the ground costs between the clusters of two."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["PairRules", "Side", "add_squares", "circular", "ground_costs"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]


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
def circular(difference: float, period: float) -> float:
    turns: float = np.rint(difference / period)
    return difference - period * turns


@njit(cache=True, nogil=True)
def add_squares(
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
    add_squares(p, q, 0, appearance, m, n, cost)
    for i in range(m):
        row = cost[i]
        for k in range(rules.position_dims):
            x = p[i, appearance + k] + shift[k]
            other = q[appearance + k]
            if k == 0 and rules.period > 0.0:
                for j in range(n):
                    t = circular(x - other[j], rules.period)
                    row[j] += t * t
            else:
                for j in range(n):
                    t = x - other[j]
                    row[j] += t * t
        for j in range(n):
            row[j] = min(np.sqrt(row[j]), rules.cap)
