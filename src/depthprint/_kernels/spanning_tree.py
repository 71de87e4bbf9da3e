"""Spanning tree of a basis, kept in preorder so that a subtree is a slice of ``order``; one pivot on it.

``order[pos[x]] == x``; ``size[x]`` nodes from ``pos[x]`` on are the subtree of x; ``flow[x]`` is the flow
between x and ``parent[x]``, from the row to the column; rows are nodes 0..rows-1. Potentials: cost +
pi[column] - pi[row] is the reduced cost of a cell, 0 in the tree.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["BIG", "pivot"]

IntArray = npt.NDArray[np.int64]
BIG = np.int64(1) << np.int64(62)


@njit(cache=True, nogil=True)
def pivot(
    i: int,
    j: int,
    reduced_cost: int,
    rows: int,
    parent: IntArray,
    order: IntArray,
    pos: IntArray,
    size: IntArray,
    flow: IntArray,
    pi: IntArray,
    temp: IntArray,
) -> None:
    """Bring cell (row node i, column node j) into the tree and hang the cut subtree on it."""
    u, w = i, j
    delta = BIG
    leave = -1
    row_side = True
    while u != w:
        if size[u] <= size[w]:
            if u < rows and flow[u] < delta:
                delta, leave, row_side = flow[u], u, True
            u = parent[u]
        else:
            if w >= rows and flow[w] < delta:
                delta, leave, row_side = flow[w], w, False
            w = parent[w]
    join = u
    u = i
    while u != join:
        flow[u] += -delta if u < rows else delta
        u = parent[u]
    w = j
    while w != join:
        flow[w] += delta if w < rows else -delta
        w = parent[w]

    inner, outer, step = (i, j, reduced_cost) if row_side else (j, i, -reduced_cost)
    moved = size[leave]
    start = pos[leave]
    x = parent[leave]
    while x != join:
        size[x] -= moved
        x = parent[x]
    x = outer
    while x != join:
        size[x] += moved
        x = parent[x]

    # preorder of the cut subtree seen from ``inner``: its slice, then what each ancestor has around it
    low = pos[inner]
    high = low + size[inner]
    k = 0
    for t in range(low, high):
        temp[k] = order[t]
        k += 1
    x = inner
    while x != leave:
        x = parent[x]
        x_low = pos[x]
        x_high = x_low + size[x]
        for t in range(x_low, low):
            temp[k] = order[t]
            k += 1
        for t in range(high, x_high):
            temp[k] = order[t]
            k += 1
        low, high = x_low, x_high

    x, above, carried, below = inner, outer, delta, 0
    while True:
        next_x, next_flow, next_below = parent[x], flow[x], size[x]
        parent[x] = above
        flow[x] = carried
        size[x] = moved - below
        if x == leave:
            break
        x, above, carried, below = next_x, x, next_flow, next_below

    if pos[outer] < start:  # nearest place: the end of outer's slice, unless the cut subtree lies inside it
        place = pos[outer] + 1 if outer == join else pos[outer] + size[outer] - moved
        for t in range(start - 1, place - 1, -1):
            y = order[t]
            order[t + moved] = y
            pos[y] = t + moved
    else:
        place = pos[outer] + 1 - moved
        for t in range(start + moved, pos[outer] + 1):
            y = order[t]
            order[t - moved] = y
            pos[y] = t - moved
    for t in range(moved):
        y = temp[t]
        order[place + t] = y
        pos[y] = place + t
        pi[y] += step
