"""What one range image says of another's points: confirmed, hidden, or in space it saw to be free."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.pixels import SeenImage, find_pixels, move_points

__all__ = ["count_agreement"]

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]


@njit(cache=True, nogil=True)
def count_agreement(
    points: Float32,
    weights: Float32,
    step: int,
    pose: Float64,
    image: SeenImage,
    counts: npt.NDArray[np.int64],
) -> float:
    """Fill counts (4,): points confirmed, hidden, in free space, and out of sight; the likeness.

    Every ``step``-th of points (m, 3) is asked, brought to the image's frame by pose (4, 4) T_image_points. A point is
    confirmed when its own pixel or one of the eight around it has its range, in free space when all of them see
    further. Likeness is a mean over the points by their ``weights`` (m,): 1 - (e / 2)^2 where the closest of these
    pixels is e < 2 standard deviations off, -1 where it sees more than 3 further, else 0.
    """
    tolerance, noise = image.tolerance, image.noise
    n = (len(points) + step - 1) // step
    moved, reach = np.empty((3, n)), np.empty(n)
    rows, columns = np.empty(n, np.int64), np.empty(n, np.int64)
    move_points(pose, points, step, moved)
    find_pixels(image, moved, np.zeros(3), rows, columns, reach)
    total, weighed = 0.0, 0.0
    confirmed = hidden = free = 0
    for k in range(n):
        r = reach[k]
        closest, nearest = _around(image.ranges, image.wraps, rows[k], columns[k], r)
        weight = np.float64(weights[k * step])
        weighed += weight
        # r is NaN for a point that no pixel sees, and then nothing below holds
        e = closest / (noise[0] + noise[1] * r + noise[2] * r * r)
        alike = 1.0 - 0.25 * e * e if abs(e) < 2.0 else 0.0
        total += weight * (-1.0 if (e > 3.0) & (nearest < math.inf) else alike)
        fits = abs(closest) <= tolerance[0] + tolerance[1] * r + tolerance[2] * r * r
        confirmed += fits
        hidden += (not fits) & (nearest < r)
        free += (not fits) & (nearest >= r) & (nearest < math.inf)
    counts[0], counts[1], counts[2], counts[3] = confirmed, hidden, free, n - confirmed - hidden - free
    return total / weighed if weighed > 0 else 0.0


@njit(cache=True, nogil=True)
def _around(ranges: Float32, wraps: bool, row: int, column: int, r: float) -> tuple[float, float]:
    """Of the returns at a pixel and around it: the difference to r of the closest, and the least; inf for none.

    At an edge a pixel stands in for what would be outside, which changes neither. There is no branch, as for pixels.
    """
    height, width = ranges.shape
    left, right = max(column - 1, 0), min(column + 1, width - 1)
    if wraps:
        left, right = (column - 1) % width, (column + 1) % width
    closest, size, least = math.inf, math.inf, math.inf
    for b in (max(row - 1, 0), row, min(row + 1, height - 1)):
        for a in (left, column, right):
            there = np.float64(ranges[b, a])
            gap = abs(there - r)
            # false for NaN too
            known = there > 0.0
            closer = known & (gap < size)
            closest = there - r if closer else closest
            size = gap if closer else size
            least = there if known & (there < least) else least
    return closest, least
