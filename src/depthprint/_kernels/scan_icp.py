"""Point-to-line alignment of two planar scans."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
import numpy.typing as npt

__all__ = ["align_scans", "line_normals", "scan_residual"]

Float64 = npt.NDArray[np.float64]


@nb.njit(cache=True)
def line_normals(points: Float64, gap: float, normals: Float64) -> None:
    """Fill normals (n, 2) of a scan (n, 2) in beam order from the neighbours two beams away; zero across a gap."""
    n = len(points)
    for i in range(n):
        a, b = max(0, i - 2), min(n - 1, i + 2)
        x, y = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        length = math.sqrt(x * x + y * y)
        reach = math.sqrt(points[i, 0] ** 2 + points[i, 1] ** 2)
        normals[i, 0] = normals[i, 1] = 0.0
        if 1e-9 < length < max(gap, 0.2 * reach):
            normals[i, 0], normals[i, 1] = -y / length, x / length


@nb.njit(cache=True)
def _beam_bearings(points: Float64, bearings: Float64) -> tuple[float, bool]:
    """Fill bearings (n,) of a scan (n, 2), from 0 at its first point; its own, and whether they ascend in one turn."""
    first = math.atan2(points[0, 1], points[0, 0]) if len(points) > 0 else 0.0
    ascend = True
    for i in range(len(points)):
        bearings[i] = (math.atan2(points[i, 1], points[i, 0]) - first) % (2.0 * math.pi)
        ascend = ascend and (i == 0 or bearings[i] >= bearings[i - 1])
    return first, ascend


@nb.njit(cache=True)
def _nearest_of(
    points: Float64, begin: int, end: int, x: float, y: float, best: float, found: int
) -> tuple[float, int]:
    for j in range(begin, end):
        d = (points[j, 0] - x) ** 2 + (points[j, 1] - y) ** 2
        if d < best:
            best, found = d, j
    return best, found


@nb.njit(cache=True)
def _nearest(
    points: Float64,
    bearings: Float64,
    first: float,
    ascend: bool,
    x: float,
    y: float,
    limit: float,
    guess: int,
) -> int:
    """The nearest point within ``limit``, or -1. ``guess``: one that may be near, -1 for none.

    first: bearing of the first point, from which the others' are. What is nearer than a point that was found lies
    at a bearing within the arcsine of its distance over the range.
    """
    n = len(points)
    best, found = limit * limit, -1
    if guess >= 0:
        best, found = _nearest_of(points, guess, guess + 1, x, y, best, found)
    reach = math.sqrt(x * x + y * y)
    near = math.sqrt(best)
    if not ascend or reach <= 1.001 * near:
        best, found = _nearest_of(points, 0, n, x, y, best, found)
        return int(found)
    off = 1.001 * math.asin(near / reach) + 1e-9
    turn = 2.0 * math.pi
    bearing = (math.atan2(y, x) - first) % turn
    begin = np.searchsorted(bearings, bearing - off)
    if bearing + off >= turn:
        end = np.searchsorted(bearings, bearing + off - turn, side="right")
        best, found = _nearest_of(points, 0, end, x, y, best, found)
    end = begin
    while end < n and bearings[end] <= bearing + off:
        end += 1
    best, found = _nearest_of(points, begin, end, x, y, best, found)
    if bearing - off < 0.0:
        begin = np.searchsorted(bearings, bearing - off + turn)
        best, found = _nearest_of(points, begin, n, x, y, best, found)
    return int(found)


@nb.njit(cache=True)
def align_scans(
    source: Float64,
    target: Float64,
    normals: Float64,
    pose: Float64,
    limit: float,
    spacing: float,
    iterations: int,
) -> None:
    """Refine pose (3,) x, y, yaw of ``source`` (n, 2) in the frame of ``target`` (m, 2), in place.

    Gauss-Newton on distances to the target's lines; pairs further apart than ``limit`` and ``spacing`` times the range
    do not count, and the limit shrinks to a quarter over the iterations.
    """
    bearings = np.empty(len(target))
    first, ascend = _beam_bearings(target, bearings)
    partners = np.full(len(source), -1, np.int64)
    for step in range(iterations):
        reach = limit * (1.0 - 0.75 * step / max(1, iterations - 1))
        c, s = math.cos(pose[2]), math.sin(pose[2])
        hessian = np.zeros((3, 3))
        gradient = np.zeros(3)
        for i in range(len(source)):
            x = c * source[i, 0] - s * source[i, 1] + pose[0]
            y = s * source[i, 0] + c * source[i, 1] + pose[1]
            apart = reach + spacing * math.sqrt(x * x + y * y)
            j = _nearest(target, bearings, first, ascend, x, y, apart, partners[i])
            partners[i] = j
            if j < 0 or (normals[j, 0] == 0.0 and normals[j, 1] == 0.0):
                continue
            nx, ny = normals[j]
            error = nx * (x - target[j, 0]) + ny * (y - target[j, 1])
            weight = 1.0 / (1.0 + (error / (0.2 * limit)) ** 2)
            slope = (nx, ny, -nx * (y - pose[1]) + ny * (x - pose[0]))
            for a in range(3):
                gradient[a] += weight * slope[a] * error
                for b in range(3):
                    hessian[a, b] += weight * slope[a] * slope[b]
        for a in range(3):
            # keeps a corridor, along which nothing is known, where it is
            hessian[a, a] += 1e-3
        change = np.linalg.solve(hessian, -gradient)
        for a in range(3):
            pose[a] += change[a]
        if abs(change[0]) + abs(change[1]) < 1e-4 and abs(change[2]) < 1e-5 and step > iterations // 2:
            break


@nb.njit(cache=True)
def scan_residual(
    source: Float64, target: Float64, pose: Float64, limit: float, spacing: float
) -> tuple[int, float]:
    """Points of ``source`` with a neighbour near enough under a pose, and the sum of squared distances.

    Near enough is ``limit`` and ``spacing`` times the range.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    bearings = np.empty(len(target))
    first, ascend = _beam_bearings(target, bearings)
    paired, total = 0, 0.0
    for i in range(len(source)):
        x = c * source[i, 0] - s * source[i, 1] + pose[0]
        y = s * source[i, 0] + c * source[i, 1] + pose[1]
        apart = limit + spacing * math.sqrt(x * x + y * y)
        j = _nearest(target, bearings, first, ascend, x, y, apart, -1)
        if j >= 0:
            paired += 1
            total += (target[j, 0] - x) ** 2 + (target[j, 1] - y) ** 2
    return paired, total
