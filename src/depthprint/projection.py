"""How pixels of a range image become points: pinhole, spherical, and one row of a laser scanner."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Union

import numpy as np
import numpy.typing as npt

from depthprint.errors import SettingsError

__all__ = ["LaserRow", "Pinhole", "Projection", "Spherical"]


@dataclass(frozen=True)
class Pinhole:
    """Camera frame: x right, y down, z forward; a pixel holds z (depth along the optical axis), in metres.

    ``fx, fy, cx, cy`` in pixels; integer pixel coordinates are pixel centres; ``cx, cy`` may lie outside
    the image (a crop).
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


@dataclass(frozen=True)
class Spherical:
    """Sensor frame: x forward, y left, z up; a pixel holds the Euclidean range, in metres.

    Column 0 is the leftmost (largest) azimuth, row 0 the highest elevation; pixel centres are half a pixel
    inside the limits. ``wraps`` is true when the columns cover the full circle.
    """

    width: int
    height: int
    azimuth_min_rad: float = -math.pi
    azimuth_max_rad: float = math.pi
    elevation_min_rad: float = math.radians(-24.9)
    elevation_max_rad: float = math.radians(2.0)

    @property
    def wraps(self) -> bool:
        """Whether the columns cover the full circle."""
        return self.azimuth_max_rad - self.azimuth_min_rad > 2 * math.pi - 1e-6


@dataclass(frozen=True)
class LaserRow:
    """One planar scan, image of shape (1, width); x forward, y left, z up; Euclidean ranges in metres.

    Beam j looks along azimuth ``angle_min_rad + j * angle_step_rad`` (CARMEN order: from right to left).
    """

    width: int
    angle_min_rad: float
    angle_step_rad: float

    @property
    def height(self) -> int:
        """Always one row."""
        return 1


Projection = Union[Pinhole, Spherical, LaserRow]
