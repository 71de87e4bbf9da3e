"""First basis of the transportation simplex: cells in the order of their doubly centred costs.

A cell counts as good when it is cheap for its row and for its column: its cost less the mean cost of its row
and of its column, means weighted by mass. Taking the least such cell again and again starts the simplex at
about half the pivots of row minima, and closer where clusters match one to one. Any basis would do, so the
means and the order may be rounded.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.scaling import bit_length
from depthprint._kernels.spanning_tree import BIG

__all__ = ["hang_tree", "mean_costs", "take_least_cells"]

IntArray = npt.NDArray[np.int64]

_WEIGHT_BITS = 12


@njit(cache=True, nogil=True)
def mean_costs(
    rows: int, columns: int, mass: IntArray, icost: IntArray, weight: IntArray, mean: IntArray
) -> None:
    """Mean cost of each row into mean[:rows], of each column into mean[rows:], weighted by ``mass``."""
    nodes = rows + columns
    total = np.int64(0)
    for i in range(rows):
        total += mass[i]
    drop = max(0, bit_length(total) - _WEIGHT_BITS)
    for x in range(nodes):
        weight[x] = mass[x] >> drop
        mean[x] = 0
    for i in range(rows):
        source, w = icost[i], weight[i]
        s = np.int64(0)
        for j in range(columns):
            c = source[j] >> _WEIGHT_BITS
            s += c * weight[rows + j]
            mean[rows + j] += c * w
        mean[i] = s
    factor = 2.0 ** (_WEIGHT_BITS + drop) / np.float64(total)
    for x in range(nodes):
        mean[x] = np.int64(mean[x] * factor)


@njit(cache=True, nogil=True)
def take_least_cells(
    rows: int,
    columns: int,
    icost: IntArray,
    left: IntArray,
    mean: IntArray,
    parent: IntArray,
    flow: IntArray,
    leaves: IntArray,
    key: IntArray,
) -> int:
    """Tree by least centred cost: ``leaves`` lists its nodes from the leaves in; returns the root, -1 if none.

    ``left`` holds the perturbed masses and is used up; ``mean`` is overwritten. Row and column ride in the low
    bits of the numbers that are compared, so that a minimum is its own place.
    """
    bits = bit_length(max(rows, columns))
    low = (np.int64(1) << bits) - 1
    for j in range(rows, rows + columns):
        mean[j] = -mean[j]
    for i in range(rows):
        source = icost[i]
        least = BIG
        for j in range(columns):
            least = min(least, ((source[j] + mean[rows + j]) & ~low) | j)
        flow[i] = least & low  # the column that the row waits for, until it is a leaf
        key[i] = ((least - mean[i]) & ~low) | i
    removed = 0
    while removed < rows + columns - 1:
        chosen = BIG
        for i in range(rows):
            chosen = min(chosen, key[i])
        if chosen == BIG:
            return -1
        i = chosen & low
        x = rows + flow[i]
        if left[x] > 0:
            if left[i] <= left[x]:
                parent[i] = x
                flow[i] = left[i]
                left[x] -= left[i]
                key[i] = BIG
                leaves[removed] = i
                removed += 1
                if left[x] == 0:
                    return x if removed == rows + columns - 1 else -1
                continue
            parent[x] = i
            flow[x] = left[x]
            left[i] -= left[x]
            left[x] = 0
            mean[x] = BIG
            leaves[removed] = x
            removed += 1
        source = icost[i]
        least = BIG
        for j in range(columns):
            least = min(least, ((source[j] + mean[rows + j]) & ~low) | j)
        flow[i] = least & low
        key[i] = ((least - mean[i]) & ~low) | i
    return -1


@njit(cache=True, nogil=True)
def hang_tree(
    rows: int,
    columns: int,
    root: int,
    icost: IntArray,
    parent: IntArray,
    leaves: IntArray,
    order: IntArray,
    pos: IntArray,
    size: IntArray,
    pi: IntArray,
) -> None:
    """Preorder, subtree sizes and potentials of the tree whose nodes ``leaves`` lists from the leaves in."""
    nodes = rows + columns
    parent[root] = -1
    for x in range(nodes):
        size[x] = 1
    for k in range(nodes - 1):
        x = leaves[k]
        size[parent[x]] += size[x]
    pos[root] = 0
    pi[root] = 0
    order[root] = 1  # while positions are dealt out, order[x] is the next free place in x's slice
    for k in range(nodes - 2, -1, -1):
        x = leaves[k]
        y = parent[x]
        pos[x] = order[y]
        order[y] += size[x]
        order[x] = pos[x] + 1
        pi[x] = icost[x, y - rows] + pi[y] if x < rows else pi[y] - icost[y, x - rows]
    for x in range(nodes):
        order[pos[x]] = x
