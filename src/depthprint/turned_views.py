"""Views of objects turned a little: what a depth image says of how it would look from beside, above or below."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage

__all__ = ["TURNS_DEG", "turn_of_points", "turned_copies", "turned_view"]

# Neighbouring pixels whose depths are further apart than this share of them lie on two surfaces.
_LARGEST_STEP = 0.02
_MARGIN_PX = 2
_MOST_DEG = 60.0
_FEWEST_PIXELS = 16

# Up and down, and right, of the copies that a recogniser learns from: chosen on training objects and simulated ones.
TURNS_DEG = ((15.0, 0.0), (-15.0, 0.0))


def turned_view(image: RangeImage, up_deg: float, right_deg: float) -> RangeImage:
    """The object of a pinhole view from a camera that went ``right_deg`` to the right, then ``up_deg`` up, about it.

    The camera stays as far from the middle of the points seen. The mask's pixels alone are drawn (all that returned
    where there is none), as a surface cut at steps in depth; what comes into sight for the first time stays without
    return. The crop is taken anew. Raises DataError for other than pinhole images and where nothing returned,
    SettingsError for more than 60 degrees.
    """
    camera = image.projection
    if not isinstance(camera, Pinhole):
        raise DataError(f"{image.source or 'view'}: expected a pinhole image, got {type(camera).__name__}")
    if not max(abs(up_deg), abs(right_deg)) <= _MOST_DEG:
        raise SettingsError(f"turn: expected up to {_MOST_DEG:g} degrees, got {up_deg} and {right_deg}")
    seen = image.valid if image.mask is None else image.valid & image.mask
    if not seen.any():
        raise DataError(f"{image.source or 'view'}: expected returns on the object, got none")
    before_m = np.where(seen, image.ranges_m, np.nan).astype(np.float64)
    points = before_m[..., None] * camera.directions()
    middle = points[seen].mean(axis=0)
    return _drawn(image, camera, before_m, (points - middle) @ turn_of_points(up_deg, right_deg).T + middle)


def turn_of_points(up_deg: float, right_deg: float) -> npt.NDArray[np.float64]:
    """Rotation (3, 3) of the points (x right, y down, z forward) when the camera goes to the right, then up."""
    up, right = math.radians(up_deg), math.radians(right_deg)
    about_y = np.array(
        [[math.cos(right), 0.0, math.sin(right)], [0.0, 1.0, 0.0], [-math.sin(right), 0.0, math.cos(right)]]
    )
    about_x = np.array(
        [[1.0, 0.0, 0.0], [0.0, math.cos(up), -math.sin(up)], [0.0, math.sin(up), math.cos(up)]]
    )
    return np.asarray(about_x @ about_y)


def _drawn(
    image: RangeImage, camera: Pinhole, before_m: npt.NDArray[np.float64], points: npt.NDArray[np.float64]
) -> RangeImage:
    from depthprint._kernels.turned_surface import draw_surface

    u, v, z_m = (axis.reshape(before_m.shape) for axis in camera.project(points.reshape(-1, 3)))
    inside = np.isfinite(u)
    left, top = (math.floor(float(axis[inside].min())) - _MARGIN_PX for axis in (u, v))
    right, bottom = (math.ceil(float(axis[inside].max())) + 1 + _MARGIN_PX for axis in (u, v))
    crop = Pinhole(camera.fx, camera.fy, camera.cx - left, camera.cy - top, right - left, bottom - top)
    ranges_m = np.full((crop.height, crop.width), np.nan, dtype=np.float32)
    draw_surface(u - left, v - top, z_m, before_m, _LARGEST_STEP, ranges_m)
    mask = None if image.mask is None else np.isfinite(ranges_m)
    return image.replace(ranges_m=ranges_m, projection=crop, mask=mask)


def turned_copies(images: Sequence[RangeImage], up_deg: float, right_deg: float) -> list[RangeImage]:
    """Each view turned, or the view itself where too little of it would be left; raises as ``turned_view`` does."""
    copies = []
    for image in images:
        copy = turned_view(image, up_deg, right_deg)
        copies.append(copy if np.count_nonzero(copy.valid) >= _FEWEST_PIXELS else image)
    return copies
