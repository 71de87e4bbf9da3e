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

SAMPLED_POINTS = 200
_SMOOTHING_PX = 1.0
_LEAST_SIZE_M = 1e-3


@lru_cache(maxsize=4)
def object_surface(image: RangeImage) -> SeenSurface:
    """Points, normals and pixels of the object in a pinhole crop, in the camera's frame, metres.

    The object is what the mask holds, all that returned where there is none; what returned beside it is background, and
    the rest unknown. Surfaces of the last few crops are kept. Raises DataError for other than pinhole images and where
    nothing returned.
    """
    from scipy.ndimage import distance_transform_edt

    from depthprint._kernels.seen_object import describe_seen
    from depthprint._kernels.surface_alignment import SeenSurface

    camera = image.projection
    if not isinstance(camera, Pinhole):
        raise DataError(f"{image.source or 'view'}: expected a pinhole image, got {type(camera).__name__}")
    image.require_returns()
    seen = image.valid if image.mask is None else image.valid & image.mask
    if not seen.any():
        # As the views that are coded have it.
        seen = image.valid
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    points, normals, depths, kinds, slopes = describe_seen(image.ranges_m, seen, _taps(), lens)
    rows, columns = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    middle = points.mean(axis=0)
    chosen = _chosen(len(points))
    surface = SeenSurface(
        points=(points[chosen] - middle).astype(np.float32),
        normals=normals[chosen].astype(np.float32),
        middle=middle,
        size=max(float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean())), _LEAST_SIZE_M),
        depths=depths,
        kinds=kinds,
        nearest=rows * np.int32(camera.width) + columns,
        slopes=slopes,
        lens=lens,
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


@lru_cache(maxsize=1)
def _taps() -> FloatArray:
    """Weights of a Gaussian at 0, 1, 2, ... pixels, up to four deviations, of sum 1 on both sides."""
    offsets = np.arange(round(4.0 * _SMOOTHING_PX) + 1)
    bell = np.exp(-0.5 * (offsets / _SMOOTHING_PX) ** 2)
    taps = bell / (2.0 * bell.sum() - bell[0])
    taps.setflags(write=False)
    return np.asarray(taps)
