"""What a depth crop shows of an object: depth smoothed within it, points and normals, and what each pixel is."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.surface_alignment import BACKGROUND, OBJECT, UNKNOWN

__all__ = ["describe_seen", "smooth_within"]

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]


@njit(cache=True, nogil=True)
def describe_seen(
    ranges_m: Float32, seen: Bool, taps: Float64, lens: Float64
) -> tuple[Float64, Float64, Float32, npt.NDArray[np.int8], Float32]:
    """Points and normals (n, 3) of the pixels that are ``seen``, row by row; depths, kinds and slopes of all pixels.

    ranges_m (h, w): z, NaN for no return. taps, lens: as ``smooth_within`` and ``SeenSurface`` have them. Normals are
    of length 1, towards the camera, from slopes within the object alone.
    """
    height, width = seen.shape
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    z_m = smooth_within(ranges_m, seen, taps)
    count = 0
    for r in range(height):
        for c in range(width):
            count += seen[r, c]
    points, normals = np.empty((count, 3)), np.empty((count, 3))
    depths = np.empty((height, width), dtype=np.float32)
    kinds = np.empty((height, width), dtype=np.int8)
    slopes = np.zeros((height, width, 3), dtype=np.float32)
    n = 0
    for r in range(height):
        for c in range(width):
            if not seen[r, c]:
                depths[r, c] = ranges_m[r, c]
                kinds[r, c] = BACKGROUND if math.isfinite(ranges_m[r, c]) else UNKNOWN
                continue
            z = z_m[r, c]
            left, right = c > 0 and seen[r, c - 1], c < width - 1 and seen[r, c + 1]
            above, below = r > 0 and seen[r - 1, c], r < height - 1 and seen[r + 1, c]
            along_u = (z_m[r, c + right] - z_m[r, c - left]) / max(left + right, 1)
            along_v = (z_m[r + below, c] - z_m[r - above, c]) / max(above + below, 1)
            nx, ny = fx * along_u, fy * along_v
            nz = -(z + (c - cx) * along_u + (r - cy) * along_v)
            length = max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
            points[n, 0], points[n, 1], points[n, 2] = z * ((c - cx) / fx), z * ((r - cy) / fy), z
            normals[n, 0], normals[n, 1], normals[n, 2] = nx / length, ny / length, nz / length
            depths[r, c] = z
            kinds[r, c] = OBJECT
            for axis in range(3):
                slopes[r, c, axis] = normals[n, axis]
            n += 1
    return points, normals, depths, kinds, slopes


@njit(cache=True, nogil=True)
def smooth_within(ranges_m: Float32, seen: Bool, taps: Float64) -> Float64:
    """Depths (h, w) of the pixels that are ``seen``, smoothed among these alone; 0 elsewhere.

    taps (k + 1,): weights of a pixel and of those 1 to k away along either axis; beyond the border pixels repeat in
    reverse order.
    """
    height, width = seen.shape
    reach = len(taps) - 1
    z_m = np.zeros((height, width))
    # Weights in the first half of a row, depths in the second, with margins on both sides of each.
    padded = width + 2 * reach
    given = np.zeros((height, 2 * width))
    for r in range(height):
        for c in range(width):
            if seen[r, c]:
                given[r, c], given[r, width + c] = 1.0, ranges_m[r, c]
    down, margined = np.empty(2 * width), np.empty((2, padded))
    sums = np.empty((2, width))
    for r in range(height):
        if not seen[r].any():
            continue
        _start(given[r], taps[0], down)
        for k in range(reach, 0, -1):
            _add(given[_reflected(r - k, height)], given[_reflected(r + k, height)], taps[k], down)
        for side in range(2):
            row = margined[side]
            row[reach : reach + width] = down[side * width : (side + 1) * width]
            for k in range(reach):
                row[k] = down[side * width + _reflected(k - reach, width)]
                row[reach + width + k] = down[side * width + _reflected(width + k, width)]
            _start(row[reach : reach + width], taps[0], sums[side])
            for k in range(reach, 0, -1):
                _add(
                    row[reach - k : reach - k + width],
                    row[reach + k : reach + k + width],
                    taps[k],
                    sums[side],
                )
        for c in range(width):
            if seen[r, c]:
                z_m[r, c] = sums[1, c] / max(sums[0, c], 1e-6)
    return z_m


@njit(cache=True, nogil=True)
def _start(values: Float64, weight: float, total: Float64) -> None:
    for c in range(len(total)):
        total[c] = weight * values[c]


@njit(cache=True, nogil=True)
def _add(before: Float64, after: Float64, weight: float, total: Float64) -> None:
    for c in range(len(total)):
        total[c] += weight * (before[c] + after[c])


@njit(cache=True, nogil=True)
def _reflected(place: int, size: int) -> int:
    """The place among ``size`` that one beyond the border repeats."""
    place %= 2 * size
    return min(place, 2 * size - 1 - place)
