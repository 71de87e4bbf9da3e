"""Normals of organised points: the direction in which the points around each vary least."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["principal_normals"]

FloatArray = npt.NDArray[np.float64]

_SWEEPS, _NEGLIGIBLE = 12, 1e-30
_LEAST_PRODUCT = 1e-6
# Blocks of a work array: places of pixels, places of neighbours, counts, sums (3) and products (6).
_LANES, _WORK_ROWS = 128, 16
_COUNT, _SUM, _SQUARE = 6 * _LANES, 7 * _LANES, 10 * _LANES


@njit(cache=True, nogil=True)
def principal_normals(points: FloatArray, reach: int, depth_ratio: float, least: int) -> FloatArray:
    """Unit normals (h, w, 3) of points (h, w, 3) with z = 0 for no return, pointing away from the origin.

    Of the window of ``reach`` pixels each way, points count whose depth differs by less than ``depth_ratio`` of the
    centre's; with fewer than ``least`` of them the normal is zero.
    """
    height, width, _ = points.shape
    normals = np.zeros((height, width, 3))
    axes = np.zeros((3, height, width + 2 * reach))
    for r in range(height):
        for c in range(width):
            for axis in range(3):
                axes[axis, r, c + reach] = points[r, c, axis]
    work = np.empty(_LANES * _WORK_ROWS)
    a, v = np.empty((3, 3)), np.empty((3, 3))
    for r in range(height):
        for start in range(0, width, _LANES):
            stop = min(start + _LANES, width)
            while start < stop and points[r, start, 2] <= 0.0:
                start += 1
            while start < stop and points[r, stop - 1, 2] <= 0.0:
                stop -= 1
            if start == stop:
                continue
            _sum_windows(axes, r, start, stop, reach, depth_ratio, work)
            for c in range(start, stop):
                k = c - start
                n = work[_COUNT + k]
                if points[r, c, 2] <= 0.0 or n < least:
                    continue
                sx, sy, sz = work[_SUM + k], work[_SUM + _LANES + k], work[_SUM + 2 * _LANES + k]
                a[0, 0] = work[_SQUARE + k] / n - sx * sx / (n * n)
                a[0, 1] = a[1, 0] = work[_SQUARE + _LANES + k] / n - sx * sy / (n * n)
                a[0, 2] = a[2, 0] = work[_SQUARE + 2 * _LANES + k] / n - sx * sz / (n * n)
                a[1, 1] = work[_SQUARE + 3 * _LANES + k] / n - sy * sy / (n * n)
                a[1, 2] = a[2, 1] = work[_SQUARE + 4 * _LANES + k] / n - sy * sz / (n * n)
                a[2, 2] = work[_SQUARE + 5 * _LANES + k] / n - sz * sz / (n * n)
                normal = normals[r, c]
                if not _plane_direction(a, normal):
                    _least_direction(a, v, normal)
                point = points[r, c]
                away = normal[0] * point[0] + normal[1] * point[1] + normal[2] * point[2]
                if away < 0.0:
                    normal *= -1.0
    return normals


@njit(cache=True, nogil=True)
def _sum_windows(
    axes: FloatArray, row: int, start: int, stop: int, reach: int, depth_ratio: float, work: FloatArray
) -> None:
    """Number of neighbours that count, and the sums and products of their offsets, of the pixels start to stop.

    axes: (3, h, w + 2 reach) coordinates, with margins of zeros.
    """
    n = stop - start
    work[:] = 0.0
    for axis in range(3):
        work[axis * _LANES : axis * _LANES + n] = axes[axis, row, start + reach : stop + reach]
    for i in range(max(0, row - reach), min(axes.shape[1], row + reach + 1)):
        for shift in range(2 * reach + 1):
            for axis in range(3):
                _copy(
                    axes[axis, i],
                    np.uint64(start + shift),
                    np.uint64(n),
                    np.uint64((3 + axis) * _LANES),
                    work,
                )
            _add_neighbours(work, np.uint64(n), depth_ratio)


@njit(cache=True, nogil=True)
def _copy(source: FloatArray, first: int, n: int, place: int, work: FloatArray) -> None:
    for k in range(n):
        work[place + k] = source[first + k]


@njit(cache=True, nogil=True)
def _add_neighbours(work: FloatArray, n: int, depth_ratio: float) -> None:
    """Add one neighbour of each pixel to its sums.

    No branches, and blocks of one array that lie a fixed number of lanes apart: so compilers do pixels side by side.
    """
    for k in range(n):
        z, other = work[k + np.uint64(2 * _LANES)], work[k + np.uint64(5 * _LANES)]
        dz = other - z
        counts = 1.0 if (other > 0.0) & (abs(dz) < depth_ratio * z) else 0.0
        dx = counts * (work[k + np.uint64(3 * _LANES)] - work[k])
        dy = counts * (work[k + np.uint64(4 * _LANES)] - work[k + np.uint64(_LANES)])
        dz = counts * dz
        work[k + np.uint64(_COUNT)] += counts
        work[k + np.uint64(_SUM)] += dx
        work[k + np.uint64(_SUM + _LANES)] += dy
        work[k + np.uint64(_SUM + 2 * _LANES)] += dz
        work[k + np.uint64(_SQUARE)] += dx * dx
        work[k + np.uint64(_SQUARE + _LANES)] += dx * dy
        work[k + np.uint64(_SQUARE + 2 * _LANES)] += dx * dz
        work[k + np.uint64(_SQUARE + 3 * _LANES)] += dy * dy
        work[k + np.uint64(_SQUARE + 4 * _LANES)] += dy * dz
        work[k + np.uint64(_SQUARE + 5 * _LANES)] += dz * dz


@njit(cache=True, nogil=True)
def _plane_direction(a: FloatArray, out: FloatArray) -> bool:
    """The same as ``_least_direction`` in closed form; False, and nothing done, where that would not be precise.

    The least root of the characteristic polynomial, then the longest product of two rows of what it leaves singular.
    """
    mean = (a[0, 0] + a[1, 1] + a[2, 2]) / 3.0
    x, y, z = a[0, 0] - mean, a[1, 1] - mean, a[2, 2] - mean
    p, q, r = a[0, 1], a[0, 2], a[1, 2]
    spread = math.sqrt((x * x + y * y + z * z + 2.0 * (p * p + q * q + r * r)) / 6.0)
    if spread <= 0.0:
        return False
    half = (x * (y * z - r * r) - p * (p * z - r * q) + q * (p * r - y * q)) / (2.0 * spread**3)
    turn = math.acos(min(1.0, max(-1.0, half))) / 3.0
    least = 2.0 * spread * math.cos(turn + 2.0 * math.pi / 3.0)
    x, y, z = x - least, y - least, z - least
    first = (p * r - q * y, q * p - x * r, x * y - p * p)
    second = (p * z - q * r, q * q - x * z, x * r - p * q)
    third = (y * z - r * r, r * q - p * z, p * r - y * q)
    longest = 0.0
    for product in (first, second, third):
        length = product[0] * product[0] + product[1] * product[1] + product[2] * product[2]
        if length > longest:
            longest = length
            out[0], out[1], out[2] = product[0], product[1], product[2]
    # Two least roots that are nearly one leave no plane, and short products that rounding turns.
    if longest < _LEAST_PRODUCT * spread**4:
        out[:] = 0.0
        return False
    length = math.sqrt(longest)
    out[0], out[1], out[2] = out[0] / length, out[1] / length, out[2] / length
    return True


@njit(cache=True, nogil=True)
def _least_direction(a: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Unit eigenvector of the least eigenvalue of a symmetric (3, 3), by Jacobi's rotations; ``a`` is used up."""
    v[:] = 0.0
    for k in range(3):
        v[k, k] = 1.0
    whole = a[0, 0] * a[0, 0] + a[1, 1] * a[1, 1] + a[2, 2] * a[2, 2]
    for _ in range(_SWEEPS):
        if a[0, 1] * a[0, 1] + a[0, 2] * a[0, 2] + a[1, 2] * a[1, 2] <= _NEGLIGIBLE * whole:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if a[p, q] == 0.0:
                    continue
                theta = 0.5 * (a[q, q] - a[p, p]) / a[p, q]
                t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                cosine = 1.0 / math.sqrt(t * t + 1.0)
                sine = t * cosine
                k = 3 - p - q
                a[p, p] -= t * a[p, q]
                a[q, q] += t * a[p, q]
                a[p, q] = a[q, p] = 0.0
                first, second = a[p, k], a[q, k]
                a[p, k] = a[k, p] = cosine * first - sine * second
                a[q, k] = a[k, q] = sine * first + cosine * second
                for i in range(3):
                    first, second = v[i, p], v[i, q]
                    v[i, p] = cosine * first - sine * second
                    v[i, q] = sine * first + cosine * second
    best = 0
    for k in range(1, 3):
        if a[k, k] < a[best, best]:
            best = k
    for i in range(3):
        out[i] = v[i, best]
