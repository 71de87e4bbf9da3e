"""Lower bounds of a transport problem from any node potentials, and the work that a distance allows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.spanning_tree import BIG

__all__ = ["dual_bound", "work_limit"]

IntArray = npt.NDArray[np.int64]

_SLACK = 1e-12
_HALF_ULP = 2.0**-53


@njit(cache=True, nogil=True)
def dual_bound(rows: int, columns: int, mass: IntArray, icost: IntArray, pi: IntArray) -> float:
    """Least work in units of mass times cost, by weak duality, less all that rounding may have added.

    The potentials of the columns are taken as they are, those of the rows as high as the costs allow.
    """
    bound = 0.0
    size = 0.0
    total = 0.0
    for i in range(rows):
        source = icost[i]
        least = BIG
        for j in range(columns):
            least = min(least, source[j] + pi[rows + j])
        term = np.float64(least) * np.float64(mass[i])
        bound += term
        size += abs(term)
        total += np.float64(mass[i])
    for x in range(rows, rows + columns):
        term = np.float64(pi[x]) * np.float64(mass[x])
        bound -= term
        size += abs(term)
    return bound - total - (2.0 * (rows + columns) + 8.0) * _HALF_ULP * size


@njit(cache=True, nogil=True)
def work_limit(distance: float, k_p: float, k_q: float, form: int) -> float:
    """Work over which `normalise` is certain to give more than ``distance``; inf where it cannot."""
    if form == 0:
        return distance * (1.0 + _SLACK)
    larger = max(k_p, k_q)
    if larger <= 0.0 or distance >= (2.0 if form == 2 else 1.0):
        return np.inf
    if form == 1:
        limit = distance * 2.0 * larger - abs(k_p - k_q)
    elif form == 2:
        limit = distance * larger
    else:
        limit = distance * (k_p + k_q) / (2.0 - distance)
    return limit + _SLACK * larger
