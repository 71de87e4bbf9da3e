"""How pixels of a range image become points: pinhole, spherical, and one row of a laser scanner."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = ["LaserRow", "Pinhole", "Projection", "Spherical"]

FloatArray = npt.NDArray[np.float64]
Pixels = tuple[FloatArray, FloatArray, FloatArray]

_FULL_CIRCLE = 2 * math.pi
_FULL_CIRCLE_SLACK = 1e-6


class _Rays:
    """What every projection does once it knows its viewing rays."""

    @property
    def R_flu_sensor(self) -> FloatArray:
        """(3, 3) rotation from the sensor frame to forward-left-up (x forward, y left, z up)."""
        return np.eye(3)

    def directions(self) -> FloatArray:
        """(height, width, 3) float64, read-only: multiplied by the ranges they give points."""
        return _cached_directions(self)

    def points(self, ranges_m: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """(height, width, 3) float32 points in the sensor frame, metres; NaN where there is no return.

        Raises DataError when the ranges (height, width) do not fit the projection.
        """
        directions = _cached_directions(self)
        ranges = np.asarray(ranges_m, dtype=np.float64)
        if ranges.shape != directions.shape[:2]:
            raise DataError(
                f"{type(self).__name__}.points: expected ranges of shape {directions.shape[:2]}, "
                f"got {ranges.shape}"
            )
        ranges = np.where(np.isfinite(ranges) & (ranges > 0), ranges, np.nan)
        return (ranges[..., None] * directions).astype(np.float32)

    def _make_directions(self) -> FloatArray:
        raise NotImplementedError


@dataclass(frozen=True)
class Pinhole(_Rays):
    """Camera frame: x right, y down, z forward; a pixel holds z (depth along the optical axis), in metres.

    ``fx, fy, cx, cy`` in pixels; integer pixel coordinates are pixel centres; ``cx, cy`` may lie outside
    the image (a crop). Raises SettingsError for focal lengths or sizes that are not positive and finite.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        _check_finite(self, "fx", "fy", "cx", "cy")
        _check_size("Pinhole", width=self.width, height=self.height)
        if not (self.fx > 0 and self.fy > 0):
            raise SettingsError(f"Pinhole: expected fx > 0 and fy > 0, got {self.fx} and {self.fy}")

    @property
    def R_flu_sensor(self) -> FloatArray:
        """(3, 3) rotation from the camera frame to forward-left-up."""
        return np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle between the left edge of the first column and the right edge of the last."""
        left = math.atan2(-0.5 - self.cx, self.fx)
        right = math.atan2(self.width - 0.5 - self.cx, self.fx)
        return right - left

    def project(self, points: npt.ArrayLike) -> Pixels:
        """Pixel coordinates of (n, 3) camera points: columns u, rows v, depths z, each (n,) float64.

        Points may fall outside the image; u and v are NaN for points that are not in front of the camera.
        """
        x, y, z = _split(points, "Pinhole.project")
        depth = np.where((z > 0) & np.isfinite(x) & np.isfinite(y) & np.isfinite(z), z, np.nan)
        with np.errstate(over="ignore", invalid="ignore"):
            return self.fx * (x / depth) + self.cx, self.fy * (y / depth) + self.cy, z

    def resized(self, width: int, height: int) -> Pinhole:
        """The same view sampled by another number of pixels."""
        _check_size("Pinhole.resized", width=width, height=height)
        sx, sy = width / self.width, height / self.height
        return Pinhole(
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
            width=width,
            height=height,
        )

    def cropped(self, left: int, top: int, width: int, height: int) -> Pinhole:
        """The view through a window of the image; raises SettingsError when the window leaves it."""
        _check_size("Pinhole.cropped", width=width, height=height)
        if left < 0 or top < 0 or left + width > self.width or top + height > self.height:
            raise SettingsError(
                f"Pinhole.cropped: expected a window inside {self.width} x {self.height}, "
                f"got left {left}, top {top}, {width} x {height}"
            )
        return replace(self, cx=self.cx - left, cy=self.cy - top, width=width, height=height)

    def _make_directions(self) -> FloatArray:
        u, v = np.meshgrid(np.arange(self.width, dtype=np.float64), np.arange(self.height, dtype=np.float64))
        return np.stack([(u - self.cx) / self.fx, (v - self.cy) / self.fy, np.ones_like(u)], axis=-1)


@dataclass(frozen=True)
class Spherical(_Rays):
    """Sensor frame: x forward, y left, z up; a pixel holds the Euclidean range, in metres.

    Column 0 is the leftmost (largest) azimuth, row 0 the highest elevation; pixel centres are half a pixel
    inside the limits. ``wraps`` is true when the columns cover the full circle. Raises SettingsError for
    limits that are not finite, not increasing, or beyond the full circle and the poles.
    """

    width: int
    height: int
    azimuth_min_rad: float = -math.pi
    azimuth_max_rad: float = math.pi
    elevation_min_rad: float = math.radians(-24.9)
    elevation_max_rad: float = math.radians(2.0)

    def __post_init__(self) -> None:
        _check_size("Spherical", width=self.width, height=self.height)
        _check_finite(self, "azimuth_min_rad", "azimuth_max_rad", "elevation_min_rad", "elevation_max_rad")
        span = self.azimuth_max_rad - self.azimuth_min_rad
        if not 0 < span <= _FULL_CIRCLE + _FULL_CIRCLE_SLACK:
            raise SettingsError(
                "Spherical: expected azimuth_min_rad < azimuth_max_rad, at most a full circle apart, "
                f"got {self.azimuth_min_rad:g} and {self.azimuth_max_rad:g}"
            )
        half = math.pi / 2 + _FULL_CIRCLE_SLACK
        if not -half <= self.elevation_min_rad < self.elevation_max_rad <= half:
            raise SettingsError(
                "Spherical: expected -pi/2 <= elevation_min_rad < elevation_max_rad <= pi/2, "
                f"got {self.elevation_min_rad:g} and {self.elevation_max_rad:g}"
            )

    @classmethod
    def vlp16(cls, width: int = 1800) -> Spherical:
        """A spinning LiDAR of 16 beams, 2 degrees apart, from -15 to 15 degrees: one row a beam."""
        return cls(width, 16, elevation_min_rad=math.radians(-16.0), elevation_max_rad=math.radians(16.0))

    @classmethod
    def hdl32(cls, width: int = 2160) -> Spherical:
        """A spinning LiDAR of 32 beams, 4/3 degrees apart, from -30.67 to 10.67 degrees: one row a beam."""
        return cls(width, 32, elevation_min_rad=math.radians(-94 / 3), elevation_max_rad=math.radians(34 / 3))

    @classmethod
    def hdl64(cls, width: int = 2048) -> Spherical:
        """A spinning LiDAR of 64 beams from -24.9 to 2 degrees, as on the KITTI car, in even rows.

        The real beams are not evenly spaced, so a row holds about one beam, not exactly one.
        """
        return cls(width, 64)

    @property
    def wraps(self) -> bool:
        """Whether the columns cover the full circle."""
        return self.azimuth_max_rad - self.azimuth_min_rad > _FULL_CIRCLE - _FULL_CIRCLE_SLACK

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle that the columns cover."""
        return self.azimuth_max_rad - self.azimuth_min_rad

    def project(self, points: npt.ArrayLike) -> Pixels:
        """Pixel coordinates of (n, 3) sensor points: columns u, rows v, ranges, each (n,) float64.

        Points may fall outside the image; with ``wraps``, u lies in [-0.5, width - 0.5). u and v are NaN for
        a point at the origin.
        """
        x, y, z = _split(points, "Spherical.project")
        planar = np.hypot(x, y)
        ranges = np.hypot(planar, z)
        there = np.where(ranges > 0, 1.0, np.nan)
        middle = 0.5 * (self.azimuth_min_rad + self.azimuth_max_rad)
        azimuth = middle + _wrapped(np.arctan2(y, x) - middle)
        u = (self.azimuth_max_rad - azimuth) * (self.width / self.horizontal_fov_rad)
        if self.wraps:
            u = np.where(u >= self.width, u - self.width, u)
        rows_per_rad = self.height / (self.elevation_max_rad - self.elevation_min_rad)
        v = (self.elevation_max_rad - np.arctan2(z, planar)) * rows_per_rad
        return (u - 0.5) * there, (v - 0.5) * there, ranges

    def resized(self, width: int, height: int) -> Spherical:
        """The same view sampled by another number of pixels."""
        return replace(self, width=width, height=height)

    def _make_directions(self) -> FloatArray:
        column_rad = self.horizontal_fov_rad / self.width
        row_rad = (self.elevation_max_rad - self.elevation_min_rad) / self.height
        azimuth = self.azimuth_max_rad - (np.arange(self.width) + 0.5) * column_rad
        elevation = self.elevation_max_rad - (np.arange(self.height) + 0.5) * row_rad
        out = np.empty((self.height, self.width, 3))
        out[..., 0] = np.cos(elevation)[:, None] * np.cos(azimuth)
        out[..., 1] = np.cos(elevation)[:, None] * np.sin(azimuth)
        out[..., 2] = np.sin(elevation)[:, None]
        return out


@dataclass(frozen=True)
class LaserRow(_Rays):
    """One planar scan, image of shape (1, width); x forward, y left, z up; Euclidean ranges in metres.

    Beam j looks along azimuth ``angle_min_rad + j * angle_step_rad`` (CARMEN order: from right to left).
    Raises SettingsError for a step of zero or beams beyond one full turn.
    """

    width: int
    angle_min_rad: float
    angle_step_rad: float

    def __post_init__(self) -> None:
        _check_size("LaserRow", width=self.width)
        _check_finite(self, "angle_min_rad", "angle_step_rad")
        if not 0 < abs(self.angle_step_rad) * self.width <= _FULL_CIRCLE + abs(self.angle_step_rad):
            raise SettingsError(
                "LaserRow: expected an angle_step_rad other than zero and beams within one full turn, "
                f"got {self.width} beams of {self.angle_step_rad:g} rad"
            )

    @property
    def height(self) -> int:
        """Always one row."""
        return 1

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle that the beams cover, each as wide as the step."""
        return min(abs(self.angle_step_rad) * self.width, _FULL_CIRCLE)

    def project(self, points: npt.ArrayLike) -> Pixels:
        """Beam number u, row v and range of (n, 3) points in the sensor frame, each (n,) float64.

        v counts downward from the scan's plane in steps of one beam, so that only points within half a step
        of the plane round to row 0. u and v are NaN for a point at the origin.
        """
        x, y, z = _split(points, "LaserRow.project")
        planar = np.hypot(x, y)
        ranges = np.hypot(planar, z)
        there = np.where(ranges > 0, 1.0, np.nan)
        middle = self.angle_min_rad + 0.5 * (self.width - 1) * self.angle_step_rad
        azimuth = middle + _wrapped(np.arctan2(y, x) - middle)
        u = (azimuth - self.angle_min_rad) / self.angle_step_rad
        v = -np.arctan2(z, planar) / abs(self.angle_step_rad)
        return u * there, v * there, ranges

    def resized(self, width: int, height: int = 1) -> LaserRow:
        """The same scan sampled by another number of beams; SettingsError for a height other than 1."""
        _check_size("LaserRow.resized", width=width)
        if height != 1:
            raise SettingsError(f"LaserRow.resized: a laser row has a height of 1, got {height}")
        step = self.angle_step_rad * self.width / width
        return LaserRow(width, self.angle_min_rad - 0.5 * self.angle_step_rad + 0.5 * step, step)

    def _make_directions(self) -> FloatArray:
        azimuth = self.angle_min_rad + np.arange(self.width) * self.angle_step_rad
        return np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(self.width)], axis=-1)[None]


Projection = Pinhole | Spherical | LaserRow


@lru_cache(maxsize=4)
def _cached_directions(projection: _Rays) -> FloatArray:
    directions = projection._make_directions()
    directions.setflags(write=False)
    return directions


def _split(points: npt.ArrayLike, where: str) -> Pixels:
    xyz = np.asarray(points, dtype=np.float64)
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise DataError(f"{where}: expected points of shape (n, 3), got {xyz.shape}")
    return xyz[:, 0], xyz[:, 1], xyz[:, 2]


def _wrapped(angle_rad: FloatArray) -> FloatArray:
    """Angles brought to [-pi, pi]."""
    return angle_rad - _FULL_CIRCLE * np.round(angle_rad / _FULL_CIRCLE)


def _check_finite(projection: Any, *names: str) -> None:
    for name in names:
        value = getattr(projection, name)
        if not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
            raise SettingsError(f"{type(projection).__name__}: expected a finite {name}, got {value!r}")


def _check_size(where: str, **sizes: object) -> None:
    for name, value in sizes.items():
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
            raise SettingsError(f"{where}: expected a whole {name} of at least 1, got {value!r}")
