"""Transport between clusters of one common weight: an assignment problem, by shortest augmenting paths.

After Jonker and Volgenant (1987): rows bid for the columns a few times over, then one shortest path for each row
still free. Prices start at the mean costs of the columns, which leaves fewer rows free than their minima. All on
integers, with feasible duals throughout, so the result is exact.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.scaling import bit_length, power_of_two
from depthprint._kernels.spanning_tree import BIG

__all__ = ["CERTIFIED", "GIVEN_UP", "UNCERTIFIED", "all_equal", "assign", "transport_units"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

_SEEN = BIG + BIG // 2  # below any price by more than a path costs
_BIDDING_ROUNDS = 3
_ROUNDING = 1.0 + 1e-12
CERTIFIED, UNCERTIFIED, GIVEN_UP = range(3)


@njit(cache=True, nogil=True)
def all_equal(values: IntArray, count: int) -> bool:
    k = 1
    while k < count and values[k] == values[0]:
        k += 1
    return k >= count


@njit(cache=True, nogil=True)
def transport_units(
    rows: int,
    columns: int,
    unit: int,
    index: IntArray,
    cost: FloatArray,
    icost: IntArray,
    parent: IntArray,
    order: IntArray,
    flow: IntArray,
    work: IntArray,
    limit: float,
) -> tuple[float, int]:
    """Least work between ``rows`` and ``columns`` clusters of mass ``unit``, what is left over going nowhere.

    ``index`` holds the places in ``cost`` of the rows, then of the columns. Writes parent, order and flow as a
    tree has them, the cells with flow last; ``work`` as in `assign` and may share memory with order and flow.
    Returns the work, and the status of `assign`.
    """
    few, many = min(rows, columns), max(rows, columns)
    first_few, first_many = (0, rows) if rows <= columns else (rows, 0)
    largest = 0.0
    for i in range(rows):
        source = cost[index[i]]
        for j in range(columns):
            largest = max(largest, source[index[rows + j]])
    c1, c2 = power_of_two(largest, 60 - bit_length(rows + columns)) if largest > 0.0 else (1.0, 1.0)
    units = icost.reshape(icost.size)[: few * many].reshape((few, many))
    for i in range(rows):
        source = cost[index[i]]
        for j in range(columns):
            c = np.int64(np.rint(source[index[rows + j]] * c1 * c2))
            if rows <= columns:
                units[i, j] = c
            else:
                units[j, i] = c
    total = 0.0
    status = assign(few, many, units, parent, work, limit / np.float64(unit) * c1 * c2 + np.float64(few))
    if status != CERTIFIED:
        return total, status
    for k in range(few):
        x, y = first_few + k, first_many + parent[k]
        parent[x] = y
        row, column = (x, y) if rows <= columns else (y, x)
        total += np.float64(unit) * cost[index[row], index[column]]
        order[many + k] = x
        flow[x] = unit
    for k in range(many):
        y = first_many + k
        parent[y] = first_few
        order[k] = y
        flow[y] = 0
    return total, status


@njit(cache=True, nogil=True)
def assign(
    rows: int, columns: int, icost: IntArray, column_of: IntArray, work: IntArray, limit: float
) -> int:
    """Columns of least total cost for the rows into column_of[:rows]; CERTIFIED where the duals certify it.

    GIVEN_UP where the duals on the way show that the total is over ``limit``. rows <= columns; costs
    (rows, columns) >= 0 whose sum along any path stays under 2**60; ``work`` has eight rows of at least
    ``columns`` numbers each.
    """
    price, hidden, distance, from_row = work[0], work[1], work[2], work[3]
    row_of, path, path_distance, free = work[4], work[5], work[6], work[7]

    for j in range(columns):
        row_of[j] = -1
        price[j] = 0
    for i in range(rows):
        column_of[i] = -1
    if rows == columns:  # else columns are left over, and their price has to stay 0
        for i in range(rows):
            source = icost[i]
            for j in range(columns):
                price[j] += source[j]
        for j in range(columns):
            price[j] //= rows
    count = _list_free(rows, column_of, free)
    for _ in range(_BIDDING_ROUNDS):
        for k in range(count):
            _bid(free[k], columns, icost[free[k]], column_of, row_of, price)
        count = _list_free(rows, column_of, free)

    for j in range(columns):
        hidden[j] = price[j]
    for k in range(count):
        if limit < np.inf and _value_of_duals(rows, columns, icost, price) > limit * _ROUNDING:
            return GIVEN_UP
        start = free[k]
        source = icost[start]
        least = BIG
        for j in range(columns):
            d = source[j] - price[j]
            distance[j] = d
            from_row[j] = start
            least = min(least, d)
        seen = 0
        while True:
            j = 0
            while distance[j] != least:
                j += 1
            i = row_of[j]
            if i < 0:
                break
            path[seen] = j
            path_distance[seen] = least
            seen += 1
            distance[j] = BIG
            hidden[j] = -_SEEN
            source = icost[i]
            offset = least - (source[j] - price[j])
            least = BIG
            for x in range(columns):
                d = source[x] - hidden[x] + offset
                nearer = d < distance[x]
                distance[x] = d if nearer else distance[x]
                from_row[x] = i if nearer else from_row[x]
                least = min(least, distance[x])
        for x in range(seen):
            y = path[x]
            price[y] += path_distance[x] - least
            hidden[y] = price[y]
        while True:
            i = from_row[j]
            row_of[j] = i
            j, column_of[i] = column_of[i], j
            if i == start:
                break
    return CERTIFIED if _certified(rows, columns, icost, column_of, row_of, price) else UNCERTIFIED


@njit(cache=True, nogil=True)
def _value_of_duals(rows: int, columns: int, icost: IntArray, price: IntArray) -> float:
    total = np.int64(0)
    for j in range(columns):
        total += price[j]
    for i in range(rows):
        source = icost[i]
        least = BIG
        for j in range(columns):
            least = min(least, source[j] - price[j])
        total += least
    return np.float64(total)


@njit(cache=True, nogil=True)
def _list_free(rows: int, column_of: IntArray, free: IntArray) -> int:
    count = 0
    for i in range(rows):
        if column_of[i] < 0:
            free[count] = i
            count += 1
    return count


@njit(cache=True, nogil=True)
def _bid(
    i: int, columns: int, source: IntArray, column_of: IntArray, row_of: IntArray, price: IntArray
) -> None:
    """Row i takes its best column at the price where its second best is as good; the owner is set free."""
    least, second = BIG, BIG
    for j in range(columns):
        d = source[j] - price[j]
        second = min(second, max(least, d))
        least = min(least, d)
    if columns == 1:
        second = least
    j = 0
    while source[j] - price[j] != least:
        j += 1
    owner = row_of[j]
    if owner >= 0:
        if second == least:
            return  # nothing to outbid the owner with; left to a shortest path
        column_of[owner] = -1
    price[j] -= second - least
    row_of[j] = i
    column_of[i] = j


@njit(cache=True, nogil=True)
def _certified(
    rows: int, columns: int, icost: IntArray, column_of: IntArray, row_of: IntArray, price: IntArray
) -> bool:
    """Whether every row has a cheapest column of its own at these prices, and columns left over cost least."""
    for i in range(rows):
        source = icost[i]
        least = BIG
        for j in range(columns):
            least = min(least, source[j] - price[j])
        j = column_of[i]
        if j < 0 or row_of[j] != i or source[j] - price[j] != least:
            return False
    if columns > rows:
        for j in range(columns):
            if price[j] > 0 or (row_of[j] < 0 and price[j] != 0):
                return False
    return True
