"""DepthView: a frame as the geometric check keeps it, thinned to what alignment needs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from depthprint.projection import LaserRow, Pinhole, Projection, Spherical
from depthprint.range_image import RangeImage
from depthprint.resampling import resample
from depthprint.verification.settings import VerificationSettings, settings_for
from depthprint.verification.surface_weights import surface_weights

__all__ = ["DepthView", "make_depth_view"]

_COUNTED_POINTS = 1200


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
    def points(self) -> npt.NDArray[np.float32]:
        """(n, 3) float32 points within reach, metres, sensor frame."""
        points = self.projection.points(self.ranges_m).reshape(-1, 3)
        return np.asarray(points[np.isfinite(points[:, 0])])

    @cached_property
    def weights(self) -> npt.NDArray[np.float32]:
        """(m,) float32: what each of ``counted`` says where agreement is judged (`surface_weights`)."""
        return surface_weights(self.counted, self.ranges_m, self.projection)

    def camera(self) -> tuple[int, npt.NDArray[np.float64], bool]:
        """Kind, parameters and wrapping of the projection, as the agreement kernel takes them."""
        from depthprint._kernels.pixels import LASER_ROW, PINHOLE, SPHERICAL

        p = self.projection
        if isinstance(p, Pinhole):
            return PINHOLE, np.array([p.fx, p.fy, p.cx, p.cy, 0.0]), False
        if isinstance(p, LaserRow):
            middle = p.angle_min_rad + 0.5 * (p.width - 1) * p.angle_step_rad
            return LASER_ROW, np.array([p.angle_min_rad, p.angle_step_rad, 0.0, 1.0, middle]), False
        column = -p.horizontal_fov_rad / p.width
        row = -(p.elevation_max_rad - p.elevation_min_rad) / p.height
        middle = 0.5 * (p.azimuth_min_rad + p.azimuth_max_rad)
        first = p.azimuth_max_rad + 0.5 * column, p.elevation_max_rad + 0.5 * row
        return SPHERICAL, np.array([first[0], column, first[1], row, middle]), p.wraps


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
