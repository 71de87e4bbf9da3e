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
    a, v = np.empty((3, 3)), np.empty((3, 3))
    for r in range(height):
        for c in range(width):
            z = points[r, c, 2]
            if z <= 0.0:
                continue
            n = 0
            sx = sy = sz = sxx = sxy = sxz = syy = syz = szz = 0.0
            for i in range(max(0, r - reach), min(height, r + reach + 1)):
                for j in range(max(0, c - reach), min(width, c + reach + 1)):
                    dz = points[i, j, 2] - z
                    if points[i, j, 2] > 0.0 and abs(dz) < depth_ratio * z:
                        dx = points[i, j, 0] - points[r, c, 0]
                        dy = points[i, j, 1] - points[r, c, 1]
                        n += 1
                        sx += dx
                        sy += dy
                        sz += dz
                        sxx += dx * dx
                        sxy += dx * dy
                        sxz += dx * dz
                        syy += dy * dy
                        syz += dy * dz
                        szz += dz * dz
            if n < least:
                continue
            a[0, 0] = sxx / n - sx * sx / (n * n)
            a[1, 1] = syy / n - sy * sy / (n * n)
            a[2, 2] = szz / n - sz * sz / (n * n)
            a[0, 1] = a[1, 0] = sxy / n - sx * sy / (n * n)
            a[0, 2] = a[2, 0] = sxz / n - sx * sz / (n * n)
            a[1, 2] = a[2, 1] = syz / n - sy * sz / (n * n)
            normal = normals[r, c]
            _least_direction(a, v, normal)
            away = normal[0] * points[r, c, 0] + normal[1] * points[r, c, 1] + normal[2] * z
            if away < 0.0:
                normal *= -1.0
    return normals


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
