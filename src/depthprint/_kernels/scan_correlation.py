"""Correlation of two planar scans over a box of offsets and turns, by branch and bound."""

from __future__ import annotations

import heapq
import math

import numba as nb
import numpy as np
import numpy.typing as npt

__all__ = ["best_correlations", "draw_points"]

Float64 = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Fields = npt.NDArray[np.uint8]


@nb.njit(cache=True, nogil=True)
def draw_points(points: Float64, cell: float, least: float, share: float, field: Fields) -> None:
    """Draw a scan (m, 2) into field (n, n) of zeros about its origin: 255 times the Gaussian of the nearest point.

    Its deviation is ``least`` and ``share`` of the point's range.
    """
    n = len(field)
    half = n // 2
    for i in range(len(points)):
        deviation = least + share * math.sqrt(points[i, 0] ** 2 + points[i, 1] ** 2)
        reach = math.ceil(2.5 * deviation / cell)
        x, y = points[i, 0] / cell + half, points[i, 1] / cell + half
        column, row = math.floor(x), math.floor(y)
        for b in range(max(0, row - reach), min(n, row + reach + 1)):
            for a in range(max(0, column - reach), min(n, column + reach + 1)):
                apart = ((a + 0.5 - x) ** 2 + (b + 0.5 - y) ** 2) * (cell / deviation) ** 2
                field[b, a] = max(field[b, a], np.uint8(255.0 * math.exp(-0.5 * apart)))


@nb.njit(cache=True, nogil=True)
def _sum_at(field: Fields, cells: Integers, weights: Integers, offset: int) -> int:
    total = 0
    for i in range(len(cells)):
        # an unsigned index is not asked whether it counts from the end
        total += weights[i] * np.int64(field[np.uint64(cells[i] + offset)])
    return int(total)


@nb.njit(cache=True, nogil=True)
def _turned_cells(points: Float64, yaws: Float64, cell: float, size: int) -> Integers:
    """Cells (k, m) of a field (size * size,) in which the points (m, 2) of a scan lie when it is turned."""
    cells = np.empty((len(yaws), len(points)), np.int64)
    for t in range(len(yaws)):
        c, s = math.cos(yaws[t]), math.sin(yaws[t])
        for i in range(len(points)):
            column = math.floor((c * points[i, 0] - s * points[i, 1]) / cell) + size // 2
            row = math.floor((s * points[i, 0] + c * points[i, 1]) / cell) + size // 2
            cells[t, i] = row * size + column
    return cells


@nb.njit(cache=True, nogil=True)
def best_correlations(
    points: Float64,
    weights: Integers,
    fields: Fields,
    cell: float,
    yaws: Float64,
    ahead: int,
    aside: int,
    beside: int,
    beside_yaw: float,
    least: float,
    poses: Float64,
    sums: Integers,
) -> int:
    """Fill poses (k, 3) x, y, yaw with the best offsets and turns of a scan (m, 2) in a field, the best first.

    The best have the greatest sums (k,), over the points, of weight (m,) times field at the point's cell. fields
    (levels, n, n): of level l the greatest of the 2^l x 2^l cells from each on; no offset may bring a point beyond
    them. Offsets reach ``ahead`` cells along x and ``aside`` along y. No two poses are within ``beside`` cells and
    ``beside_yaw``, and none has less than ``least`` of the best one's sum. Returns how many there are.
    """
    size = fields.shape[1]
    flat = fields.reshape(len(fields), size * size)
    cells = _turned_cells(points, yaws, cell, size)
    top = len(fields) - 1
    # Windows of offsets by their bound, the best first: of what level, turn, and first offset.
    heap = [(0, 0, 0, 0, 0) for _ in range(0)]
    for t in range(len(yaws)):
        for b in range(-aside, aside + 1, 2**top):
            for a in range(-ahead, ahead + 1, 2**top):
                heap.append((-_sum_at(flat[top], cells[t], weights, b * size + a), top, t, a, b))
    heapq.heapify(heap)
    found, most = 0, 0
    while len(heap) > 0 and found < len(poses):
        bound, level, t, a, b = heapq.heappop(heap)
        if -bound < least * most or bound == 0:
            break
        x, y, wide = a * cell, b * cell, (2**level - 1) * cell
        covered = False
        for j in range(found):
            # half a cell is for rounding
            reach = (beside + 0.5) * cell
            covered |= (
                abs(yaws[t] - poses[j, 2]) <= beside_yaw
                and poses[j, 0] - reach <= x
                and x + wide <= poses[j, 0] + reach
                and poses[j, 1] - reach <= y
                and y + wide <= poses[j, 1] + reach
            )
        if covered:
            continue
        if level == 0:
            most = max(most, -bound)
            poses[found, 0], poses[found, 1], poses[found, 2] = x, y, yaws[t]
            sums[found] = -bound
            found += 1
            continue
        half = 2 ** (level - 1)
        for v in (b, b + half):
            for u in (a, a + half):
                if u <= ahead and v <= aside:
                    total = _sum_at(flat[level - 1], cells[t], weights, v * size + u)
                    heapq.heappush(heap, (-total, level - 1, t, u, v))
    return found
