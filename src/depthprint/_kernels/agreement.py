"""What one range image says of another's points: confirmed, hidden, or in space it saw to be free."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
import numpy.typing as npt

from depthprint._kernels.pixels import moved_point, seen_by

__all__ = ["count_agreement"]

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]


@nb.njit(cache=True)
def count_agreement(
    points: Float32,
    weights: Float32,
    poses: Float64,
    kind: int,
    camera: Float64,
    wraps: bool,
    ranges: Float32,
    tolerance: Float64,
    noise: Float64,
    neighbours: int,
    counts: npt.NDArray[np.int64],
    likeness: Float64,
) -> None:
    """Fill counts (m, 4): points confirmed, hidden, in free space, and out of sight, for each pose; likeness (m,).

    points (n, 3), of which poses (m, 4, 4) T_target_points bring them to the frame of ``ranges`` (h, w), whose
    NaN say nothing. tolerance (3,): metres, share of the range, share of its square a metre. A point is confirmed
    when a pixel within ``neighbours`` of its own has its range, in free space when all of them see further.
    likeness is a mean over the points by their ``weights`` (n,): 1 - (e / 2)^2 where the closest of these pixels is
    e < 2 standard deviations off, -1 where it sees more than 3 further, else 0. noise (3,): as tolerance, of one
    deviation.
    """
    height, width = ranges.shape
    for m in range(len(poses)):
        pose = poses[m]
        total, weighed = 0.0, 0.0
        for c in range(4):
            counts[m, c] = 0
        for k in range(len(points)):
            x, y, z = moved_point(pose, float(points[k, 0]), float(points[k, 1]), float(points[k, 2]))
            row, column, r = seen_by(kind, camera, wraps, height, width, x, y, z)
            weight = np.float64(weights[k])
            weighed += weight
            if row < 0:
                counts[m, 3] += 1
                continue
            allowed = tolerance[0] + tolerance[1] * r + tolerance[2] * r * r
            nearest, seen, confirmed, closest = math.inf, False, False, math.inf
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
                    there = ranges[b, a]
                    if not there > 0:
                        continue
                    seen = True
                    nearest = min(nearest, there)
                    if abs(there - r) < abs(closest):
                        closest = there - r
                    if abs(there - r) <= allowed:
                        confirmed = True
            if seen:
                e = closest / (noise[0] + noise[1] * r + noise[2] * r * r)
                if abs(e) < 2.0:
                    total += weight * (1.0 - 0.25 * e * e)
                elif e > 3.0:
                    total -= weight
            if not seen:
                counts[m, 3] += 1
            elif confirmed:
                counts[m, 0] += 1
            elif nearest < r:
                counts[m, 1] += 1
            else:
                counts[m, 2] += 1
        likeness[m] = total / weighed if weighed > 0 else 0.0
