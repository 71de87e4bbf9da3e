"""DepthView: a frame as the geometric check keeps it, thinned to what alignment needs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from depthprint.projection import LaserRow, Pinhole, Projection, Spherical
from depthprint.range_image import RangeImage
from depthprint.resampling import resample
from depthprint.verification.settings import VerificationSettings, settings_for

if TYPE_CHECKING:
    from depthprint._kernels.pixels import SeenImage

__all__ = ["DepthView", "make_depth_view", "read_only"]

Real = TypeVar("Real", bound=np.floating[Any])

_COUNTED_POINTS = 1200
_FULL_CIRCLE_RAD = 2 * math.pi - 1e-3


@dataclass(frozen=True, eq=False)
class DepthView:
    """One frame, thinned. Views compare and hash by identity, so that what is made of one can be kept.

    ranges_m: (h, w) float32, NaN where there is nothing within reach. projection: of these pixels.
    points: (n, 3) float32 in the sensor frame, all of them. counted: (m, 3) float32, those that the overlap is
    counted over, evenly drawn, without the ground. settings: of the sensor.
    """

    ranges_m: npt.NDArray[np.float32]
    projection: Projection
    counted: npt.NDArray[np.float32]
    settings: VerificationSettings

    @property
    def planar(self) -> bool:
        """Whether it is one row of a scanner, in whose plane all poses lie."""
        return isinstance(self.projection, LaserRow)

    @property
    def full_circle(self) -> bool:
        """Whether it sees all around, so that it is seen alike under all headings."""
        return self.projection.horizontal_fov_rad > _FULL_CIRCLE_RAD

    @property
    def points(self) -> npt.NDArray[np.float32]:
        """(n, 3) float32 points within reach, metres, sensor frame."""
        points = self.projection.points(self.ranges_m).reshape(-1, 3)
        return np.asarray(points[np.isfinite(points[:, 0])])

    @cached_property
    def weights(self) -> npt.NDArray[np.float32]:
        """(m,) float32, read-only: what each of ``counted`` says where agreement is judged, as in `surface_weights`."""
        from depthprint.verification.surface_weights import row_weights
        from depthprint.verification.view_surface import surface_of

        if self.planar:
            return read_only(row_weights(self.counted), np.float32)
        return read_only(surface_of(self).weights, np.float32)

    @cached_property
    def image(self) -> SeenImage:
        """The view as kernels project points into it."""
        from depthprint._kernels.pixels import SeenImage

        kind, lens, wraps = _lens_of(self.projection)
        tolerance, noise = _errors_of(self.settings)
        ranges_m = read_only(self.ranges_m, np.float32)
        return SeenImage(kind, lens, wraps, ranges_m, self.projection.directions(), tolerance, noise)

    @cached_property
    def counted_by_kernels(self) -> npt.NDArray[np.float32]:
        """``counted`` in the layout that kernels take."""
        return read_only(self.counted, np.float32)


def read_only(array: npt.NDArray[Any], dtype: type[Real]) -> npt.NDArray[Real]:
    """A contiguous copy or view of an array that is not to be written: what kernels are compiled for."""
    view: npt.NDArray[Real] = np.ascontiguousarray(array, dtype=dtype)[...]
    view.setflags(write=False)
    return view


@lru_cache(maxsize=16)
def _lens_of(p: Projection) -> tuple[int, npt.NDArray[np.float64], bool]:
    """Kind, parameters and wrapping of a projection, as kernels take them."""
    from depthprint._kernels.pixels import LASER_ROW, PINHOLE, SPHERICAL

    kind, wraps = LASER_ROW, False
    if isinstance(p, Pinhole):
        kind, values = PINHOLE, (p.fx, p.fy, p.cx, p.cy, 0.0)
    elif isinstance(p, LaserRow):
        middle = p.angle_min_rad + 0.5 * (p.width - 1) * p.angle_step_rad
        values = p.angle_min_rad, p.angle_step_rad, 0.0, 1.0, middle
    else:
        column = -p.horizontal_fov_rad / p.width
        row = -(p.elevation_max_rad - p.elevation_min_rad) / p.height
        middle = 0.5 * (p.azimuth_min_rad + p.azimuth_max_rad)
        kind, wraps = SPHERICAL, p.wraps
        values = p.azimuth_max_rad + 0.5 * column, column, p.elevation_max_rad + 0.5 * row, row, middle
    lens = np.array(values, dtype=np.float64)
    lens.setflags(write=False)
    return kind, lens, wraps


@lru_cache(maxsize=16)
def _errors_of(settings: VerificationSettings) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Tolerance and noise (3,) each; the tolerance for both where the noise is not known."""
    both = np.array([settings.tolerance, settings.noise or settings.tolerance], dtype=np.float64)
    both.setflags(write=False)
    return both[0], both[1]


def make_depth_view(image: RangeImage, settings: VerificationSettings | None = None) -> DepthView:
    """Thin a frame for the geometric check; ``settings`` None takes those that suit its sensor.

    Raises DataError, naming the frame, when it holds no return.
    """
    image.require_returns()
    settings = settings_for(image) if settings is None else settings
    height, width = image.shape
    step = math.ceil(width / settings.columns)
    if step > 1:
        # A spinning sensor has few rows, and each is a beam of its own.
        rows = height if isinstance(image.projection, Spherical) else math.ceil(height / step)
        image = resample(image.replace(mask=None), math.ceil(width / step), rows, method="nearest")
    ranges_m = np.where(image.ranges_m <= settings.reach_m, image.ranges_m, np.float32(np.nan))
    ranges_m.setflags(write=False)
    points = image.projection.points(ranges_m).reshape(-1, 3)
    keep = np.isfinite(points[:, 0])
    if image.sensor_height_m is not None and not isinstance(image.projection, LaserRow):
        up = image.projection.R_flu_sensor[2]
        keep &= points @ up + image.sensor_height_m > settings.ground_clearance_m
    counted = points[keep]
    # Each return counts as often as the sensor sees it, so that a share is a share of the view.
    counted = counted[np.linspace(0, len(counted) - 1, min(len(counted), _COUNTED_POINTS)).astype(np.int64)]
    counted.setflags(write=False)
    return DepthView(ranges_m, image.projection, counted, settings)
