"""Exact transportation simplex (dense costs) on integers: no tolerance, no degenerate pivot, no cycling.

Masses and costs are rounded once to 64-bit integers scaled by powers of two (about 2**-55 of the largest), so
every sum below is exact. Row masses are then perturbed by one unit of a finer scale (Charnes): each basic
flow stays positive, each pivot lowers the objective, and the simplex ends. The flows of the unperturbed
masses are read off the final tree. The spanning tree is kept in preorder, so that a subtree is a slice. Clusters
of one common mass are an assignment problem, which `depthprint._kernels.assignment` solves faster.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.assignment import CERTIFIED, GIVEN_UP, all_equal, transport_units
from depthprint._kernels.dual_bound import dual_bound
from depthprint._kernels.scaling import bit_length, power_of_two
from depthprint._kernels.spanning_tree import BIG, pivot
from depthprint._kernels.start_basis import hang_tree, mean_costs, take_least_cells

__all__ = [
    "ABANDONED",
    "BAD_CERTIFICATE",
    "OPTIMAL",
    "PIVOT_LIMIT",
    "make_scratch",
    "solve_pair",
    "solve_transport",
    "write_flow",
]

OPTIMAL = 0
PIVOT_LIMIT = 1
BAD_CERTIFICATE = 2
ABANDONED = 3

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

# Rows of the integer scratch, each as long as rows + columns + 2.
_MASS, _INDEX, _PARENT, _ORDER, _POS, _SIZE, _FLOW, _PI, _TEMP = range(9)
_SCRATCH_ROWS = 11  # the last two, and those from _ORDER on, are work space of an assignment
_ROWS_PRICED = 6


@njit(cache=True, nogil=True)
def make_scratch(m: int, n: int) -> tuple[IntArray, IntArray]:
    """Work space of one thread for problems of up to m x n clusters."""
    return np.empty((_SCRATCH_ROWS, m + n + 2), np.int64), np.empty((m + 1, n + 1), np.int64)


@njit(cache=True, nogil=True)
def solve_transport(
    weights_p: FloatArray,
    weights_q: FloatArray,
    cost: FloatArray,
    m: int,
    n: int,
    surplus_cost: float,
    balance: bool,
    limit: float,
    ints: IntArray,
    icost: IntArray,
) -> tuple[float, int, int, int, int]:
    """Least work to move weights_p[:m] onto weights_q[:n] at cost[:m, :n]; the surplus pays ``surplus_cost``.

    With ``balance`` the masses are equal up to rounding and the largest cluster takes what rounding left.
    ABANDONED, without a tree, where a lower bound shows that the work is over ``limit``; inf for no limit.
    Returns (work, status, rows, columns, exponent of the mass scale); the scratch then holds the final tree
    for `write_flow`.
    """
    mass, index, parent, order, pos = ints[_MASS], ints[_INDEX], ints[_PARENT], ints[_ORDER], ints[_POS]
    size, flow, pi, temp = ints[_SIZE], ints[_FLOW], ints[_PI], ints[_TEMP]

    # --- integer masses, zero ones dropped
    mass_p = 0.0
    for i in range(m):
        mass_p += weights_p[i]
    mass_q = 0.0
    for j in range(n):
        mass_q += weights_q[j]
    largest = max(mass_p, mass_q)
    if largest <= 0.0:
        return 0.0, OPTIMAL, 0, 0, 0
    mass_bits = 61 - bit_length(m + 2)
    s1, s2 = power_of_two(largest, mass_bits)
    exponent = mass_bits - math.frexp(largest)[1]
    rows = 0
    total_p = np.int64(0)
    for i in range(m):
        w = np.int64(np.rint(weights_p[i] * s1 * s2))
        if w > 0:
            mass[rows] = w
            index[rows] = i
            total_p += w
            rows += 1
    columns = 0
    total_q = np.int64(0)
    for j in range(n):
        w = np.int64(np.rint(weights_q[j] * s1 * s2))
        if w > 0:
            mass[rows + columns] = w
            index[rows + columns] = j
            total_q += w
            columns += 1
    surplus = total_p - total_q
    if balance and surplus != 0:
        first, last = (rows, rows + columns) if surplus > 0 else (0, rows)
        heaviest = first
        for x in range(first, last):
            if mass[x] > mass[heaviest]:
                heaviest = x
        mass[heaviest] += abs(surplus)
        surplus = np.int64(0)
    if all_equal(mass, rows + columns) and rows > 0 and columns > 0:
        extra = np.float64(abs(surplus)) * surplus_cost
        work, status = transport_units(
            rows,
            columns,
            mass[0],
            index,
            cost,
            icost,
            parent,
            order,
            flow,
            ints[_ORDER:],
            limit * s1 * s2 - extra,
        )
        if status == GIVEN_UP:
            return np.inf, ABANDONED, rows, columns, exponent
        status = OPTIMAL if status == CERTIFIED else BAD_CERTIFICATE
        return (work + extra) / s1 / s2, status, rows, columns, exponent
    m_real, n_real = rows, columns
    if surplus > 0:
        mass[rows + columns] = surplus
        index[rows + columns] = n
        columns += 1
    elif surplus < 0:
        for x in range(rows + columns, rows, -1):
            mass[x] = mass[x - 1]
            index[x] = index[x - 1]
        mass[rows] = -surplus
        index[rows] = m
        rows += 1
    nodes = rows + columns

    # --- integer costs
    largest_cost = surplus_cost
    for i in range(m_real):
        source = cost[index[i]]
        for j in range(n_real):
            largest_cost = max(largest_cost, source[index[rows + j]])
    c1, c2 = power_of_two(largest_cost, 61 - bit_length(nodes)) if largest_cost > 0.0 else (1.0, 1.0)
    dummy = np.int64(np.rint(surplus_cost * c1 * c2))
    for i in range(m_real):
        source = cost[index[i]]
        target = icost[i]
        for j in range(n_real):
            target[j] = np.int64(np.rint(source[index[rows + j]] * c1 * c2))
        if columns > n_real:
            target[n_real] = dummy
    if rows > m_real:
        for j in range(columns):
            icost[m_real, j] = dummy

    # --- start
    mean_costs(rows, columns, mass, icost, temp, size)
    for i in range(rows):
        pi[i] = mass[i] * (rows + 1) + 1
    for j in range(rows, nodes):
        pi[j] = mass[j] * (rows + 1)
    pi[nodes - 1] += rows  # pi holds the perturbed masses until it holds potentials
    root = take_least_cells(rows, columns, icost, pi, size, parent, flow, temp, order)
    if root < 0:
        return 0.0, BAD_CERTIFICATE, rows, columns, exponent
    hang_tree(rows, columns, root, icost, parent, temp, order, pos, size, pi)

    # --- pivots: the most negative cell of a few rows, rows in turn, until no row has any
    pivots = 0
    most_pivots = 1000 * nodes + 100000
    next_bound = 0
    bound_limit = limit * c1 * c2 * s1 * s2
    i = 0
    left = rows
    while left > 0:
        if pivots >= next_bound and bound_limit < np.inf:
            if dual_bound(rows, columns, mass, icost, pi) > bound_limit:
                return np.inf, ABANDONED, rows, columns, exponent
            next_bound = 2 * pivots + 2
        best_row, best_sum, worst = -1, np.int64(0), np.int64(0)
        for _ in range(min(_ROWS_PRICED, left)):
            source_i = icost[i]
            least = BIG
            for j in range(columns):
                least = min(least, source_i[j] + pi[rows + j])
            if least - pi[i] < worst:
                best_row, best_sum, worst = i, least, least - pi[i]
            left -= 1
            i += 1
            if i == rows:
                i = 0
        if best_row >= 0:
            source_i = icost[best_row]
            j = rows
            while source_i[j - rows] + pi[j] != best_sum:
                j += 1
            pivots += 1
            if pivots > most_pivots:
                return 0.0, PIVOT_LIMIT, rows, columns, exponent
            pivot(best_row, j, worst, rows, parent, order, pos, size, flow, pi, temp)
            left = rows

    # --- flows of the unperturbed masses, and the certificate: tree cells tight, flows not negative
    for x in range(nodes):
        temp[x] = mass[x] if x < rows else -mass[x]
    work = 0.0
    for k in range(nodes - 1, 0, -1):
        x = order[k]
        y = parent[x]
        temp[y] += temp[x]
        if x < rows:
            moved, row, column = temp[x], x, y - rows
        else:
            moved, row, column = -temp[x], y, x - rows
        if moved < 0 or icost[row, column] + pi[rows + column] != pi[row]:
            return 0.0, BAD_CERTIFICATE, rows, columns, exponent
        flow[x] = moved
        if moved > 0:
            price = surplus_cost
            if row < m_real and column < n_real:
                price = cost[index[row], index[rows + column]]
            work += np.float64(moved) * price
    if temp[order[0]] != 0:
        return 0.0, BAD_CERTIFICATE, rows, columns, exponent
    return work / s1 / s2, OPTIMAL, rows, columns, exponent


@njit(cache=True, nogil=True)
def write_flow(
    rows: int, columns: int, exponent: int, m: int, n: int, ints: IntArray, flow: FloatArray
) -> None:
    """Flows (m, n) of the last `solve_transport`, in the units of its weights; the surplus is left out."""
    index, parent, order, flow_of = ints[_INDEX], ints[_PARENT], ints[_ORDER], ints[_FLOW]
    half = exponent // 2
    s1, s2 = math.ldexp(1.0, half), math.ldexp(1.0, exponent - half)
    flow[:] = 0.0
    for k in range(1, rows + columns):
        x = order[k]
        row, column = (x, parent[x]) if x < rows else (parent[x], x)
        if index[row] < m and index[column] < n:
            flow[index[row], index[column]] = np.float64(flow_of[x]) / s1 / s2


@njit(cache=True, nogil=True)
def solve_pair(
    weights_p: FloatArray, weights_q: FloatArray, cost: FloatArray, surplus_cost: float, balance: bool
) -> tuple[float, int, FloatArray]:
    """One problem with scratch of its own: (work, status, flow (m, n))."""
    m, n = cost.shape
    ints, icost = make_scratch(m, n)
    work, status, rows, columns, exponent = solve_transport(
        weights_p, weights_q, cost, m, n, surplus_cost, balance, np.inf, ints, icost
    )
    flow = np.zeros((m, n))
    if status == OPTIMAL and rows > 0:
        write_flow(rows, columns, exponent, m, n, ints, flow)
    return work, status, flow
