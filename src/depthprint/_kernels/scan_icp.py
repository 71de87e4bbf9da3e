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
def _nearest(points: Float64, x: float, y: float, limit: float) -> int:
    best, found = limit * limit, -1
    for j in range(len(points)):
        d = (points[j, 0] - x) ** 2 + (points[j, 1] - y) ** 2
        if d < best:
            best, found = d, j
    return found


@nb.njit(cache=True)
def align_scans(
    source: Float64, target: Float64, normals: Float64, pose: Float64, limit: float, iterations: int
) -> None:
    """Refine pose (3,) x, y, yaw of ``source`` (n, 2) in the frame of ``target`` (m, 2), in place.

    Gauss-Newton on distances to the target's lines; pairs further apart than ``limit`` do not count, and the
    limit shrinks to a quarter over the iterations.
    """
    for step in range(iterations):
        reach = limit * (1.0 - 0.75 * step / max(1, iterations - 1))
        c, s = math.cos(pose[2]), math.sin(pose[2])
        hessian = np.zeros((3, 3))
        gradient = np.zeros(3)
        for i in range(len(source)):
            x = c * source[i, 0] - s * source[i, 1] + pose[0]
            y = s * source[i, 0] + c * source[i, 1] + pose[1]
            j = _nearest(target, x, y, reach)
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
def scan_residual(source: Float64, target: Float64, pose: Float64, limit: float) -> tuple[int, float]:
    """Points of ``source`` with a neighbour within ``limit`` under a pose, and the sum of squared distances."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    paired, total = 0, 0.0
    for i in range(len(source)):
        x = c * source[i, 0] - s * source[i, 1] + pose[0]
        y = s * source[i, 0] + c * source[i, 1] + pose[1]
        j = _nearest(target, x, y, limit)
        if j >= 0:
            paired += 1
            total += (target[j, 0] - x) ** 2 + (target[j, 1] - y) ** 2
    return paired, total
