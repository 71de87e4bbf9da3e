"""Which pixel of a range image a point falls on, for every kind of projection."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["LASER_ROW", "PINHOLE", "SPHERICAL", "SeenImage", "moved_point", "seen_by"]

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
    column, row = math.floor(u + 0.5), math.floor(v + 0.5)
    if wraps and column >= width:
        column -= width
    if wraps and column < 0:
        column += width
    if r < 0 or column < 0 or row < 0 or column >= width or row >= height:
        return -1, -1, r
    return int(row), int(column), r
