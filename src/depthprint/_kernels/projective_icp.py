"""Point-to-plane alignment of points with a range image: partners are found by projection, without a tree."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.pixels import SeenImage, find_pixels, move_points, moved_point, seen_by

__all__ = [
    "align_by_projection",
    "move_pose",
    "normal_equations",
    "projective_residual",
    "solve_step",
    "window_normals",
]

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]

_DAMPING = 1e-3


class Work(NamedTuple):
    """Pixels and ranges of points, (n,) each, as `find_pixels` fills them."""

    rows: npt.NDArray[np.int64]
    columns: npt.NDArray[np.int64]
    reach: Float64


@njit(cache=True, nogil=True)
def window_normals(
    ranges: Float32,
    directions: Float64,
    rows: npt.NDArray[np.int64],
    columns: npt.NDArray[np.int64],
    reach: int,
    edge_ratio: float,
    wraps: bool,
    points: Float64,
    normals: Float64,
) -> None:
    """Fill points and normals (n, 3) of some pixels; a normal is zero where the window holds no surface.

    The tangents are the regressions of the window's points on column and row; returns whose range differs by more
    than ``edge_ratio`` of the centre's are another surface's.
    """
    height, width = ranges.shape
    for k in range(len(rows)):
        r, c = rows[k], columns[k]
        centre = np.float64(ranges[r, c])
        for a in range(3):
            points[k, a] = centre * directions[r, c, a]
            normals[k, a] = 0.0
        n = 0
        su = sv = suu = suv = svv = 0.0
        sx = sy = sz = ux = uy = uz = vx = vy = vz = 0.0
        for i in range(max(0, r - reach), min(height, r + reach + 1)):
            for dj in range(-reach, reach + 1):
                j = c + dj
                if wraps:
                    j %= width
                elif j < 0 or j >= width:
                    continue
                there = np.float64(ranges[i, j])
                if not abs(there - centre) < edge_ratio * centre:
                    continue
                u, v = np.float64(dj), np.float64(i - r)
                x = there * directions[i, j, 0] - points[k, 0]
                y = there * directions[i, j, 1] - points[k, 1]
                z = there * directions[i, j, 2] - points[k, 2]
                n += 1
                su += u
                sv += v
                suu += u * u
                suv += u * v
                svv += v * v
                sx += x
                sy += y
                sz += z
                ux += u * x
                uy += u * y
                uz += u * z
                vx += v * x
                vy += v * y
                vz += v * z
        if n < 5:
            continue
        suu -= su * su / n
        svv -= sv * sv / n
        suv -= su * sv / n
        if suu * svv - suv * suv < 1e-6 * suu * svv:
            continue
        # both tangents, up to one positive factor
        ux, uy, uz = ux - su * sx / n, uy - su * sy / n, uz - su * sz / n
        vx, vy, vz = vx - sv * sx / n, vy - sv * sy / n, vz - sv * sz / n
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length > 1e-12:
            normals[k, 0], normals[k, 1], normals[k, 2] = nx / length, ny / length, nz / length


@njit(cache=True, nogil=True)
def solve_step(hessian: Float64, gradient: Float64, step: Float64) -> bool:
    """Solve the 6 x 6 system by Cholesky's factors, in place; False where it is not positive definite."""
    for j in range(6):
        for i in range(j, 6):
            value = hessian[i, j]
            for k in range(j):
                value -= hessian[i, k] * hessian[j, k]
            if i == j:
                if not value > 0.0:
                    return False
                hessian[j, j] = math.sqrt(value)
            else:
                hessian[i, j] = value / hessian[j, j]
    for i in range(6):
        value = gradient[i]
        for k in range(i):
            value -= hessian[i, k] * step[k]
        step[i] = value / hessian[i, i]
    for i in range(5, -1, -1):
        value = step[i]
        for k in range(i + 1, 6):
            value -= hessian[k, i] * step[k]
        step[i] = value / hessian[i, i]
    return True


@njit(cache=True, nogil=True)
def move_pose(pose: Float64, step: Float64, rotation: Float64, moved: Float64) -> None:
    """Put exp(step) in front of a pose: step (6,) is a rotation vector and a translation; the rest is room to work."""
    wx, wy, wz = step[0], step[1], step[2]
    angle = math.sqrt(wx * wx + wy * wy + wz * wz)
    a = math.sin(angle) / angle if angle > 1e-9 else 1.0
    b = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-4 else 0.5
    rotation[0, 0], rotation[1, 1], rotation[2, 2] = (
        1.0 - b * (wy * wy + wz * wz),
        1.0 - b * (wx * wx + wz * wz),
        1.0 - b * (wx * wx + wy * wy),
    )
    rotation[0, 1], rotation[1, 0] = b * wx * wy - a * wz, b * wx * wy + a * wz
    rotation[0, 2], rotation[2, 0] = b * wx * wz + a * wy, b * wx * wz - a * wy
    rotation[1, 2], rotation[2, 1] = b * wy * wz - a * wx, b * wy * wz + a * wx
    for i in range(3):
        for j in range(4):
            value = 0.0
            for k in range(3):
                value += rotation[i, k] * pose[k, j]
            moved[i, j] = value
        moved[i, 3] += step[3 + i]
    for i in range(3):
        for j in range(4):
            pose[i, j] = moved[i, j]


@njit(cache=True, nogil=True)
def _linearised(
    pose: Float64, moved: Float64, normals: Float64, image: SeenImage, limit: float, work: Work, rows: Float64
) -> int:
    """Fill rows (n, 8) of moved points that have a partner: slope of the error (6,), error, weight; how many have."""
    t0, t1, t2 = image.tolerance[0], image.tolerance[1], image.tolerance[2]
    p00, p01, p02 = pose[0, 0], pose[0, 1], pose[0, 2]
    p10, p11, p12 = pose[1, 0], pose[1, 1], pose[1, 2]
    p20, p21, p22 = pose[2, 0], pose[2, 1], pose[2, 2]
    n = 0
    for k in range(moved.shape[1]):
        x, y, z = moved[0, k], moved[1, k], moved[2, k]
        a, b, r = work.rows[k], work.columns[k], work.reach[k]
        there = np.float64(image.ranges[a, b])
        sigma = t0 + t1 * r + t2 * r * r
        allowed = max(limit, 2.0 * sigma)
        gx = there * image.directions[a, b, 0] - x
        gy = there * image.directions[a, b, 1] - y
        gz = there * image.directions[a, b, 2] - z
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        sx = p00 * nx + p01 * ny + p02 * nz
        sy = p10 * nx + p11 * ny + p12 * nz
        sz = p20 * nx + p21 * ny + p22 * nz
        error = sx * gx + sy * gy + sz * gz
        share = error / allowed
        row = rows[n]
        row[0], row[1], row[2] = y * sz - z * sy, z * sx - x * sz, x * sy - y * sx
        row[3], row[4], row[5] = sx, sy, sz
        row[6] = error
        row[7] = (1.0 - share * share) ** 2 / (sigma * sigma)
        # The row is kept by counting it, not by a branch; false for NaN too.
        n += (abs(there - r) < 2.0 * allowed) & (abs(share) < 1.0)
    return n


@njit(cache=True, nogil=True)
def normal_equations(rows: Float64, n: int, hessian: Float64, gradient: Float64) -> None:
    """Fill the lower half of hessian (6, 6) and gradient (6,) from n rows, two by two: sums stay in registers."""
    for i in range(0, 6, 2):
        for j in range(0, i + 1, 2):
            aa = ab = ba = bb = 0.0
            for k in range(n):
                first, second = rows[k, 7] * rows[k, i], rows[k, 7] * rows[k, i + 1]
                aa += first * rows[k, j]
                ab += first * rows[k, j + 1]
                ba += second * rows[k, j]
                bb += second * rows[k, j + 1]
            hessian[i, j], hessian[i + 1, j], hessian[i + 1, j + 1] = aa, ba, bb
            if i != j:
                hessian[i, j + 1] = ab
        a = b = 0.0
        for k in range(n):
            a += rows[k, 7] * rows[k, i] * rows[k, 6]
            b += rows[k, 7] * rows[k, i + 1] * rows[k, 6]
        gradient[i], gradient[i + 1] = a, b


@njit(cache=True, nogil=True)
def align_by_projection(
    points: Float64,
    normals: Float64,
    image: SeenImage,
    limit: float,
    shrink: float,
    iterations: int,
    pose: Float64,
) -> None:
    """Refine a pose (4, 4) T_image_points in place by Gauss-Newton on distances along the points' normals.

    points, normals (n, 3), in the points' frame. A point's partner is the return of the pixel that it falls on, within
    ``limit`` metres; its weight falls to zero there (Tukey), and ``limit`` shrinks by a factor each iteration, down to
    twice the image's tolerance.
    """
    hessian, gradient, step = np.empty((6, 6)), np.empty(6), np.empty(6)
    rotation, moved_pose = np.empty((3, 3)), np.empty((3, 4))
    total = len(points)
    moved, rows, nowhere = np.empty((3, total)), np.empty((total + 1, 8)), np.zeros(3)
    work = Work(np.empty(total, np.int64), np.empty(total, np.int64), np.empty(total))
    reach = limit
    for _ in range(iterations):
        move_points(pose, points, 1, moved)
        find_pixels(image, moved, nowhere, work.rows, work.columns, work.reach)
        n = _linearised(pose, moved, normals, image, reach, work, rows)
        normal_equations(rows, n, hessian, gradient)
        for i in range(6):
            # keeps a pose where it is along what nothing tells
            hessian[i, i] = hessian[i, i] * (1.0 + _DAMPING) + 1e-6
        if not solve_step(hessian, gradient, step):
            break
        move_pose(pose, step, rotation, moved_pose)
        turned = abs(step[0]) + abs(step[1]) + abs(step[2])
        shifted = abs(step[3]) + abs(step[4]) + abs(step[5])
        least = image.tolerance[0]
        if turned < 1e-3 and shifted < 0.05 * least and reach < 2.0 * least:
            break
        reach *= shrink


@njit(cache=True, nogil=True)
def projective_residual(
    points: Float64, normals: Float64, image: SeenImage, limit: float, pose: Float64
) -> tuple[int, float]:
    """Points with a partner within ``limit`` along their normals, and the sum of these squared distances."""
    height, width = image.ranges.shape
    paired, total = 0, 0.0
    for k in range(len(points)):
        x, y, z = moved_point(pose, points[k, 0], points[k, 1], points[k, 2])
        row, column, r = seen_by(image.kind, image.lens, image.wraps, height, width, x, y, z)
        if row < 0:
            continue
        there = np.float64(image.ranges[row, column])
        # false for NaN too
        if not abs(there - r) < 2.0 * limit:
            continue
        error = 0.0
        for a in range(3):
            turned = pose[a, 0] * normals[k, 0] + pose[a, 1] * normals[k, 1] + pose[a, 2] * normals[k, 2]
            moved = x if a == 0 else (y if a == 1 else z)
            error += turned * (there * image.directions[row, column, a] - moved)
        if abs(error) < limit:
            paired += 1
            total += error * error
    return paired, total
