"""Histograms of pairs of surface points, and of what lies halfway between them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.surface_alignment import OBJECT, SeenSurface

__all__ = ["N_ALIKE", "N_ANGLES", "N_HALFWAY", "N_LENGTHS", "pair_histograms"]

Float64 = npt.NDArray[np.float64]

# Bins: beside, behind or before the surface; of lengths; of the angles with the line, unordered; of the normals.
N_HALFWAY, N_LENGTHS, N_ANGLES, N_ALIKE = 3, 10, 5, 3
_BESIDE, _BEHIND, _BEFORE = 0, 1, 2


@njit(cache=True, nogil=True, error_model="numpy")
def pair_histograms(surface: SeenSurface, shortest: Float64, longest: Float64) -> Float64:
    """Counts (k, N_HALFWAY, N_LENGTHS, N_ANGLES (N_ANGLES + 1) / 2, N_ALIKE) of all pairs of a surface's points.

    shortest, longest (k,): ends of the scales of lengths, metres, which are logarithmic; a pair counts in the two bins
    nearest to its length, and beyond the ends in the last one. Pairs closer than a tenth of a millimetre do not count.
    """
    points, normals, middle, lens = surface.points, surface.normals, surface.middle, surface.lens
    depths, kinds = surface.depths, surface.kinds
    height, width = kinds.shape
    scales = len(shortest)
    firsts, steps = np.empty(scales), np.empty(scales)
    for k in range(scales):
        firsts[k] = math.log(shortest[k])
        steps[k] = N_LENGTHS / (math.log(longest[k]) - firsts[k])
    counts = np.zeros((scales, N_HALFWAY, N_LENGTHS, N_ANGLES * (N_ANGLES + 1) // 2, N_ALIKE))
    for i in range(len(points)):
        for j in range(i + 1, len(points)):
            dx = float(points[j, 0] - points[i, 0])
            dy = float(points[j, 1] - points[i, 1])
            dz = float(points[j, 2] - points[i, 2])
            squared = dx * dx + dy * dy + dz * dz
            if squared < 1e-8:
                continue
            per_metre = 1.0 / math.sqrt(squared)
            away = (normals[i, 0] * dx + normals[i, 1] * dy + normals[i, 2] * dz) * per_metre
            back = -(normals[j, 0] * dx + normals[j, 1] * dy + normals[j, 2] * dz) * per_metre
            alike = (
                normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
            )
            low, high = _bin(min(away, back), N_ANGLES), _bin(max(away, back), N_ANGLES)
            angles = high * (high + 1) // 2 + low
            normal = _bin(alike, N_ALIKE)
            z = middle[2] + 0.5 * (points[i, 2] + points[j, 2])
            column = lens[0] * (middle[0] + 0.5 * (points[i, 0] + points[j, 0])) / z + lens[2]
            row = lens[1] * (middle[1] + 0.5 * (points[i, 1] + points[j, 1])) / z + lens[3]
            halfway, r, c = _BESIDE, math.floor(row + 0.5), math.floor(column + 0.5)
            if 0 <= r < height and 0 <= c < width and kinds[r, c] == OBJECT:
                halfway = _BEHIND if z > depths[r, c] else _BEFORE
            log_length = 0.5 * math.log(squared)
            for k in range(scales):
                at = min(max((log_length - firsts[k]) * steps[k] - 0.5, 0.0), N_LENGTHS - 1.0)
                first = min(int(at), N_LENGTHS - 2)
                rest = at - first
                counts[k, halfway, first, angles, normal] += 1.0 - rest
                counts[k, halfway, first + 1, angles, normal] += rest
    return counts


@njit(cache=True, nogil=True)
def _bin(cosine: float, bins: int) -> int:
    return min(max(int((cosine + 1.0) * 0.5 * bins), 0), bins - 1)
