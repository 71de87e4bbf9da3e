"""The surface that a depth crop shows of an object, made ready to be aligned with others."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage

if TYPE_CHECKING:
    from depthprint._kernels.surface_alignment import SeenSurface

__all__ = ["SAMPLED_POINTS", "object_surface"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

SAMPLED_POINTS = 200
_SMOOTHING_PX = 1.0
_LEAST_SIZE_M = 1e-3


def object_surface(image: RangeImage) -> SeenSurface:
    """Points, normals and pixels of the object in a pinhole crop, in the camera's frame, metres.

    The object is what the mask holds, all that returned where there is none; what returned beside it is background, and
    the rest unknown. Raises DataError for other than pinhole images and where nothing returned.
    """
    from scipy.ndimage import distance_transform_edt

    from depthprint._kernels.surface_alignment import BACKGROUND, OBJECT, UNKNOWN, SeenSurface

    camera = image.projection
    if not isinstance(camera, Pinhole):
        raise DataError(f"{image.source or 'view'}: expected a pinhole image, got {type(camera).__name__}")
    image.require_returns()
    seen = image.valid if image.mask is None else image.valid & image.mask
    if not seen.any():
        # As the views that are coded have it.
        seen = image.valid
    z_m = _smoothed(image.ranges_m, seen)
    normals = _normals(z_m, seen, camera)
    slopes = np.zeros((*seen.shape, 3), dtype=np.float32)
    slopes[seen] = normals
    beside = image.valid & ~seen
    kinds = np.where(seen, OBJECT, np.where(beside, BACKGROUND, UNKNOWN)).astype(np.int8)
    depths = np.where(seen, z_m, np.where(beside, image.ranges_m, np.nan)).astype(np.float32)
    rows, columns = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    at = np.nonzero(seen)
    z = z_m[at]
    points = np.stack(
        [z * ((at[1] - camera.cx) / camera.fx), z * ((at[0] - camera.cy) / camera.fy), z], axis=-1
    )
    middle = points.mean(axis=0)
    chosen = _chosen(len(points))
    surface = SeenSurface(
        points=(points[chosen] - middle).astype(np.float32),
        normals=normals[chosen].astype(np.float32),
        middle=np.asarray(middle, dtype=np.float64),
        size=max(float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean())), _LEAST_SIZE_M),
        depths=depths,
        kinds=kinds,
        nearest=(rows * camera.width + columns).astype(np.int32),
        slopes=slopes,
        lens=np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
    )
    for values in surface:
        if isinstance(values, np.ndarray):
            values.setflags(write=False)
    return surface


@lru_cache(maxsize=4096)
def _chosen(count: int) -> npt.NDArray[np.int64]:
    """Which of so many pixels are sampled: the same ones every time, spread without a pattern."""
    chosen = np.sort(np.random.default_rng(0).permutation(count)[:SAMPLED_POINTS])
    chosen.setflags(write=False)
    return chosen


def _smoothed(ranges_m: npt.NDArray[np.float32], seen: BoolArray) -> FloatArray:
    """Depths smoothed within the object, 0 elsewhere."""
    from scipy.ndimage import gaussian_filter

    weight = gaussian_filter(seen.astype(np.float64), _SMOOTHING_PX)
    total = gaussian_filter(np.where(seen, ranges_m, 0.0).astype(np.float64), _SMOOTHING_PX)
    return np.where(seen, total / np.maximum(weight, 1e-6), 0.0)


def _normals(z_m: FloatArray, seen: BoolArray, camera: Pinhole) -> FloatArray:
    """Unit normals (n, 3) towards the camera at the object's pixels; slopes are taken within the object alone."""
    z = z_m[seen]
    along_u, along_v = _slope(z_m, seen)[seen], _slope(z_m.T, seen.T).T[seen]
    rows, columns = np.nonzero(seen)
    normals = np.stack(
        [
            camera.fx * along_u,
            camera.fy * along_v,
            -(z + (columns - camera.cx) * along_u + (rows - camera.cy) * along_v),
        ],
        axis=-1,
    )
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12))


def _slope(z_m: FloatArray, seen: BoolArray) -> FloatArray:
    """Difference of depth a column, over neighbours that belong to the object."""
    before, after = np.zeros_like(seen), np.zeros_like(seen)
    before[:, 1:], after[:, :-1] = seen[:, :-1], seen[:, 1:]
    low = np.where(before, np.roll(z_m, 1, axis=1), z_m)
    high = np.where(after, np.roll(z_m, -1, axis=1), z_m)
    return np.asarray((high - low) / np.maximum(before.astype(np.int64) + after, 1))
