"""Loops over the points around a point: covariances of windows, spin coordinates, distance kernels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["mean_distance_kernels", "spin_coordinates", "window_covariances"]

FloatArray = npt.NDArray[np.float64]

# exp(-gamma d^2) beyond this distance in units of the last basis point is under exp(-gamma): nothing.
_FAR = 2.0


@njit(cache=True, nogil=True)
def window_covariances(
    points: FloatArray, reach: int, depth_ratio: float
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Covariance (h, w, 3, 3) and count (h, w) of the points of each window that lie at about its centre's depth."""
    height, width, _ = points.shape
    covariances = np.zeros((height, width, 3, 3))
    counts = np.zeros((height, width), dtype=np.int64)
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
            counts[r, c] = n
            covariance = covariances[r, c]
            covariance[0, 0] = sxx / n - sx * sx / (n * n)
            covariance[1, 1] = syy / n - sy * sy / (n * n)
            covariance[2, 2] = szz / n - sz * sz / (n * n)
            covariance[0, 1] = covariance[1, 0] = sxy / n - sx * sy / (n * n)
            covariance[0, 2] = covariance[2, 0] = sxz / n - sx * sz / (n * n)
            covariance[1, 2] = covariance[2, 1] = syz / n - sy * sz / (n * n)
    return covariances, counts


@njit(cache=True, nogil=True)
def spin_coordinates(
    points: FloatArray,
    normals: FloatArray,
    rows: npt.NDArray[np.int64],
    columns: npt.NDArray[np.int64],
    patch: int,
    order: npt.NDArray[np.int64],
    radius: float,
    most: int,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int64]]:
    """Cosine to the centre's normal, distance along it and across it, of points within ``radius`` of the centre.

    The pixels of a patch are visited in ``order`` and the first ``most`` points taken: (patches, most, 3), counts.
    Points and centres without a normal are passed over.
    """
    coordinates = np.zeros((len(rows) * len(columns), most, 3), dtype=np.float32)
    counts = np.zeros(len(rows) * len(columns), dtype=np.int64)
    half = patch // 2
    number = -1
    for top in rows:
        for left in columns:
            number += 1
            centre, axis = points[top + half, left + half], normals[top + half, left + half]
            if centre[2] <= 0.0 or (axis[0] == 0.0 and axis[1] == 0.0 and axis[2] == 0.0):
                continue
            n = 0
            for place in order:
                r, c = top + place // patch, left + place % patch
                normal = normals[r, c]
                if points[r, c, 2] <= 0.0 or (normal[0] == 0.0 and normal[1] == 0.0 and normal[2] == 0.0):
                    continue
                dx = points[r, c, 0] - centre[0]
                dy = points[r, c, 1] - centre[1]
                dz = points[r, c, 2] - centre[2]
                squared = dx * dx + dy * dy + dz * dz
                if squared >= radius * radius:
                    continue
                along = axis[0] * dx + axis[1] * dy + axis[2] * dz
                cosine = axis[0] * normal[0] + axis[1] * normal[1] + axis[2] * normal[2]
                coordinates[number, n, 0] = min(1.0, max(-1.0, cosine))
                coordinates[number, n, 1] = along
                coordinates[number, n, 2] = np.sqrt(max(squared - along * along, 0.0))
                n += 1
                if n == most:
                    break
            counts[number] = n
    return coordinates, counts


@njit(cache=True, nogil=True)
def mean_distance_kernels(
    centres: FloatArray, cloud: FloatArray, n_basis: int, step: float, gamma: float
) -> FloatArray:
    """Mean over the cloud of exp(-gamma (d - k step)^2), d the distance to a centre: (centres, n_basis).

    The Gaussians of one distance are a geometric series times a constant one, so an exponential is taken once.
    """
    sums = np.zeros((len(centres), n_basis))
    series = np.empty(n_basis)
    for k in range(n_basis):
        series[k] = np.exp(-gamma * (k * step) ** 2)
    end = step * (n_basis - 1)
    for i in range(len(centres)):
        for p in range(len(cloud)):
            squared = 0.0
            for axis in range(3):
                squared += (centres[i, axis] - cloud[p, axis]) ** 2
            distance = np.sqrt(squared)
            if distance > _FAR * end:
                continue
            factor = np.exp(2.0 * gamma * distance * step)
            value = np.exp(-gamma * squared)
            for k in range(n_basis):
                sums[i, k] += value * series[k]
                value *= factor
    return sums / len(cloud)
