"""Which pixel of a range image a point falls on, for every kind of projection."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = [
    "LASER_ROW",
    "PINHOLE",
    "SPHERICAL",
    "SeenImage",
    "find_pixels",
    "move_points",
    "moved_point",
    "seen_by",
    "turn_points",
]

PINHOLE, SPHERICAL, LASER_ROW = 0, 1, 2

Float64 = npt.NDArray[np.float64]


class SeenImage(NamedTuple):
    """A range image that points are projected into; all arrays are read-only.

    kind, lens, wraps: of the projection, as ``seen_by`` takes them. ranges (h, w), NaN for nothing; ranges times
    directions (h, w, 3) are points. tolerance, noise (3,): metres, share of the range, share of its square a metre.
    """

    kind: int
    lens: Float64
    wraps: bool
    ranges: npt.NDArray[np.float32]
    directions: Float64
    tolerance: Float64
    noise: Float64


@njit(cache=True, nogil=True)
def moved_point(pose: Float64, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point brought to another frame by a pose (4, 4)."""
    return (
        pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3],
        pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3],
        pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3],
    )


@njit(cache=True, nogil=True)
def _pixel(kind: int, camera: Float64, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Column, row and range of a point; a range of -1 for one that no pixel can see."""
    if kind == PINHOLE:
        if z <= 1e-6:
            return 0.0, 0.0, -1.0
        return camera[0] * x / z + camera[2], camera[1] * y / z + camera[3], z
    planar = math.sqrt(x * x + y * y)
    reach = math.sqrt(planar * planar + z * z)
    if reach <= 1e-6:
        return 0.0, 0.0, -1.0
    # camera: azimuth of column 0, azimuth a column, elevation of row 0, elevation a row, middle azimuth
    turn = math.atan2(y, x) - camera[4]
    turn -= 2 * math.pi * round(turn / (2 * math.pi))
    u = (camera[4] + turn - camera[0]) / camera[1]
    if kind == LASER_ROW:
        return u, 0.0, reach
    return u, (math.atan2(z, planar) - camera[2]) / camera[3], reach


@njit(cache=True, nogil=True)
def seen_by(
    kind: int, camera: Float64, wraps: bool, height: int, width: int, x: float, y: float, z: float
) -> tuple[int, int, float]:
    """Row, column and range of the pixel that a point falls on; row -1 where none does."""
    u, v, r = _pixel(kind, camera, x, y, z)
    u, v = u + 0.5, v + 0.5
    if wraps:
        u = np.floor(u)
        u = u - width if u >= width else u
        u = u + width if u < 0.0 else u
    # one branch for all; false for NaN too
    if not ((r >= 0.0) & (u >= 0.0) & (u < width) & (v >= 0.0) & (v < height)):
        return -1, -1, r
    return int(v), int(u), r


@njit(cache=True, nogil=True)
def turn_points(pose: Float64, points: npt.NDArray[np.floating], step: int, turned: Float64) -> None:
    """Fill turned (3, n) with every ``step``-th of points (m, 3), turned by a pose (4, 4) but not shifted."""
    for i in range(3):
        a, b, c = pose[i, 0], pose[i, 1], pose[i, 2]
        for k in range(turned.shape[1]):
            point = points[k * step]
            turned[i, k] = a * np.float64(point[0]) + b * np.float64(point[1]) + c * np.float64(point[2])


@njit(cache=True, nogil=True)
def move_points(pose: Float64, points: npt.NDArray[np.floating], step: int, moved: Float64) -> None:
    """Fill moved (3, n) with every ``step``-th of points (m, 3), brought to another frame by a pose (4, 4)."""
    turn_points(pose, points, step, moved)
    for i in range(3):
        shift = pose[i, 3]
        for k in range(moved.shape[1]):
            moved[i, k] += shift


@njit(cache=True, nogil=True)
def find_pixels(
    image: SeenImage,
    points: Float64,
    shift: Float64,
    rows: npt.NDArray[np.int64],
    columns: npt.NDArray[np.int64],
    reach: Float64,
) -> None:
    """Fill rows, columns, reach (n,): pixel and range of points (3, n) plus shift (3,), as `seen_by`.

    For one that no pixel sees the pixel is 0, 0 and the range NaN.
    """
    height, width = image.ranges.shape
    sx, sy, sz = shift[0], shift[1], shift[2]
    if image.kind != PINHOLE:
        for k in range(len(reach)):
            row, column, r = seen_by(
                image.kind, image.lens, image.wraps, height, width,
                points[0, k] + sx, points[1, k] + sy, points[2, k] + sz,
            )  # fmt: skip
            seen = row >= 0
            rows[k], columns[k], reach[k] = row if seen else 0, column if seen else 0, r if seen else np.nan
        return
    # Where a point falls is hard to foresee for a processor: without a branch this takes a fifth of the time.
    fx, fy, cx, cy = image.lens[0], image.lens[1], image.lens[2], image.lens[3]
    for k in range(len(reach)):
        x, y, z = points[0, k] + sx, points[1, k] + sy, points[2, k] + sz
        depth = z if z > 1e-6 else 1.0
        u, v = fx * x / depth + cx + 0.5, fy * y / depth + cy + 0.5
        seen = (z > 1e-6) & (u >= 0.0) & (u < width) & (v >= 0.0) & (v < height)
        rows[k] = np.int64(v if seen else 0.0)
        columns[k] = np.int64(u if seen else 0.0)
        reach[k] = z if seen else np.nan
