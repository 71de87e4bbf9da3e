"""What one range image says of another's points: confirmed, hidden, or in space it saw to be free."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.pixels import SeenImage, moved_point, seen_by

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
    neighbours: int,
    counts: npt.NDArray[np.int64],
) -> float:
    """Fill counts (4,): points confirmed, hidden, in free space, and out of sight; the likeness.

    Every ``step``-th of points (n, 3) is asked, brought to the image's frame by pose (4, 4) T_image_points. A point is
    confirmed when a pixel within ``neighbours`` of its own has its range, in free space when all of them see further.
    Likeness is a mean over the points by their ``weights`` (n,): 1 - (e / 2)^2 where the closest of these pixels is
    e < 2 standard deviations off, -1 where it sees more than 3 further, else 0.
    """
    tolerance, noise = image.tolerance, image.noise
    height, width = image.ranges.shape
    total, weighed = 0.0, 0.0
    confirmed = hidden = free = unseen = 0
    for k in range(0, len(points), step):
        x, y, z = moved_point(
            pose, np.float64(points[k, 0]), np.float64(points[k, 1]), np.float64(points[k, 2])
        )
        row, column, r = seen_by(image.kind, image.lens, image.wraps, height, width, x, y, z)
        weight = np.float64(weights[k])
        weighed += weight
        if row < 0:
            unseen += 1
            continue
        closest, nearest = _around(image.ranges, row, column, r, neighbours, image.wraps)
        if not nearest < math.inf:
            unseen += 1
            continue
        e = closest / (noise[0] + noise[1] * r + noise[2] * r * r)
        if abs(e) < 2.0:
            total += weight * (1.0 - 0.25 * e * e)
        elif e > 3.0:
            total -= weight
        if abs(closest) <= tolerance[0] + tolerance[1] * r + tolerance[2] * r * r:
            confirmed += 1
        elif nearest < r:
            hidden += 1
        else:
            free += 1
    counts[0], counts[1], counts[2], counts[3] = confirmed, hidden, free, unseen
    return total / weighed if weighed > 0 else 0.0


@njit(cache=True, nogil=True)
def _around(
    ranges: Float32, row: int, column: int, r: float, neighbours: int, wraps: bool
) -> tuple[float, float]:
    """Of the returns at a pixel and its neighbours: the difference to r of the closest, and the least; inf for none."""
    height, width = ranges.shape
    closest, size, least = math.inf, math.inf, math.inf
    if neighbours == 1 and 0 < row < height - 1 and 0 < column < width - 1:
        # Most points: no neighbour is outside, and none is branched on.
        for dv in range(-1, 2):
            for du in range(-1, 2):
                there = np.float64(ranges[row + dv, column + du])
                gap = there - r
                # false for NaN too
                known = there > 0.0
                closer = known & (abs(gap) < size)
                closest = gap if closer else closest
                size = abs(gap) if closer else size
                least = there if known & (there < least) else least
        return closest, least
    for dv in range(-neighbours, neighbours + 1):
        b = row + dv
        if b < 0 or b >= height:
            continue
        for du in range(-neighbours, neighbours + 1):
            a = column + du
            if wraps:
                a %= width
            if a < 0 or a >= width:
                continue
            there = np.float64(ranges[b, a])
            if not there > 0.0:
                continue
            least = min(least, there)
            if abs(there - r) < size:
                closest, size = there - r, abs(there - r)
    return closest, least
