"""Normals of organised points: the direction in which the points around each vary least."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["principal_normals"]

FloatArray = npt.NDArray[np.float64]

_SWEEPS, _NEGLIGIBLE = 12, 1e-30


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
    sums = np.empty((10, width))
    a, v = np.empty((3, 3)), np.empty((3, 3))
    for r in range(height):
        first = last = -1
        for c in range(width):
            if points[r, c, 2] > 0.0:
                first = c if first < 0 else first
                last = c
        if first < 0:
            continue
        sums[:] = 0.0
        for i in range(max(0, r - reach), min(height, r + reach + 1)):
            for shift in range(2 * reach + 1):
                _add_neighbours(axes, r, i, reach, shift, first, last + 1, depth_ratio, sums)
        for c in range(first, last + 1):
            n = sums[0, c]
            if points[r, c, 2] <= 0.0 or n < least:
                continue
            sx, sy, sz = sums[1, c], sums[2, c], sums[3, c]
            a[0, 0] = sums[4, c] / n - sx * sx / (n * n)
            a[1, 1] = sums[7, c] / n - sy * sy / (n * n)
            a[2, 2] = sums[9, c] / n - sz * sz / (n * n)
            a[0, 1] = a[1, 0] = sums[5, c] / n - sx * sy / (n * n)
            a[0, 2] = a[2, 0] = sums[6, c] / n - sx * sz / (n * n)
            a[1, 2] = a[2, 1] = sums[8, c] / n - sy * sz / (n * n)
            normal = normals[r, c]
            _least_direction(a, v, normal)
            point = points[r, c]
            away = normal[0] * point[0] + normal[1] * point[1] + normal[2] * point[2]
            if away < 0.0:
                normal *= -1.0
    return normals


@njit(cache=True, nogil=True)
def _add_neighbours(
    axes: FloatArray,
    row: int,
    other: int,
    reach: int,
    shift: int,
    first: int,
    last: int,
    depth_ratio: float,
    sums: FloatArray,
) -> None:
    """Add one neighbour of each pixel of a row to its sums; no branches, so that pixels are done side by side."""
    x, y, z = axes[0, row, reach:], axes[1, row, reach:], axes[2, row, reach:]
    u, v, w = axes[0, other, shift:], axes[1, other, shift:], axes[2, other, shift:]
    n, sx, sy, sz, sxx = sums[0], sums[1], sums[2], sums[3], sums[4]
    sxy, sxz, syy, syz, szz = sums[5], sums[6], sums[7], sums[8], sums[9]
    for c in range(np.uint64(first), np.uint64(last)):
        dz = w[c] - z[c]
        counts = 1.0 if (w[c] > 0.0) & (abs(dz) < depth_ratio * z[c]) else 0.0
        dx = counts * (u[c] - x[c])
        dy = counts * (v[c] - y[c])
        dz = counts * dz
        n[c] += counts
        sx[c] += dx
        sy[c] += dy
        sz[c] += dz
        sxx[c] += dx * dx
        sxy[c] += dx * dy
        sxz[c] += dx * dz
        syy[c] += dy * dy
        syz[c] += dy * dz
        szz[c] += dz * dz


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
