"""Lower bounds from one short vector a signature, and from boxes around the vectors of neighbouring items.

The vector of a signature is the weighted sum of its clusters' appearances, each drawn into the ball of radius
R = cap / 2. Drawing in is 1-Lipschitz for the ground distance, so matched mass moves the sum by no more than
its work, and surplus mass s by at most s R (Rubner's centroid bound for a capped ground distance and unequal
masses). Vectors are float32; ``slack`` is more than their rounding for a unit of mass.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from depthprint._kernels.ground import PairRules
from depthprint._kernels.relaxation import normalise

__all__ = ["add_block_bounds", "add_item_bounds"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

_ITEMS_PER_TASK = 1024


@njit(cache=True, nogil=True)
def _work(gap: float, least_surplus: float, most_surplus: float, slack: float, rules: PairRules) -> float:
    moved = max(gap - slack - 0.5 * most_surplus * rules.cap, 0.0)
    return moved + least_surplus * rules.surplus_cost


@njit(cache=True, parallel=True)
def add_item_bounds(
    vector: Float32Array,
    mass: float,
    complexity: float,
    vectors: Float32Array,
    masses: FloatArray,
    complexities: FloatArray,
    items: IntArray,
    slack: float,
    weight: float,
    rules: PairRules,
    out: FloatArray,
) -> None:
    """Add ``weight`` times the bound of the distance to each of ``items`` to ``out`` (len(items),)."""
    tasks = (len(items) + _ITEMS_PER_TASK - 1) // _ITEMS_PER_TASK
    dims = len(vector)
    shrink = 1.0 - 1.2e-7 * (dims + 16)
    for task in prange(tasks):
        for x in range(task * _ITEMS_PER_TASK, min(len(items), (task + 1) * _ITEMS_PER_TASK)):
            item = items[x]
            other = masses[item]
            if mass <= 0.0 or other <= 0.0:
                emd = complexity + complexities[item]
            else:
                square = np.float32(0.0)
                for k in range(dims):
                    t = vector[k] - vectors[item, k]
                    square += t * t
                surplus = 0.0 if rules.balance else abs(mass - other)
                emd = _work(
                    np.sqrt(np.float64(square)) * shrink, surplus, surplus, slack * (mass + other), rules
                )
                if rules.divide:
                    emd /= min(mass, other)
            out[x] += weight * normalise(emd, complexity, complexities[item], rules.form)


@njit(cache=True, nogil=True)
def add_block_bounds(
    vector: Float32Array,
    mass: float,
    complexity: float,
    low: Float32Array,
    high: Float32Array,
    mass_range: FloatArray,
    largest_complexity: FloatArray,
    slack: float,
    weight: float,
    rules: PairRules,
    out: FloatArray,
) -> None:
    """Add ``weight`` times a bound of the distance to every item of each block to ``out`` (blocks,)."""
    dims = len(vector)
    shrink = 1.0 - 1.2e-7 * (dims + 16)
    for b in range(len(out)):
        lightest, heaviest = mass_range[b, 0], mass_range[b, 1]
        if mass <= 0.0 or lightest <= 0.0:
            continue
        square = np.float32(0.0)
        for k in range(dims):
            t = max(max(low[b, k] - vector[k], vector[k] - high[b, k]), np.float32(0.0))
            square += t * t
        least = most = 0.0
        if not rules.balance:
            least = max(max(lightest - mass, mass - heaviest), 0.0)
            most = max(heaviest - mass, mass - lightest)
        emd = _work(np.sqrt(np.float64(square)) * shrink, least, most, slack * (mass + heaviest), rules)
        if rules.divide:
            emd /= min(mass, heaviest)
        larger = max(complexity, largest_complexity[b])
        if rules.form == 1:  # the difference of complexities is left out: it is not monotone in the item's
            emd = emd / (2.0 * larger) if larger > 0.0 else 0.0
        elif rules.form > 1:
            emd = normalise(emd, complexity, largest_complexity[b], rules.form)
        out[b] += weight * emd
