"""Hole-aware resampling to the working size: a hole is NaN, never zero, never averaged in."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.projection import LaserRow, Projection, Spherical
from depthprint.range_image import RangeImage

__all__ = ["fill_holes", "resample"]

Method = Literal["mean", "median", "nearest"]


def resample(
    image: RangeImage,
    width: int = 96,
    height: int = 96,
    *,
    method: Method = "mean",
    min_valid_share: float = 0.0,
    edge_ratio: float = 0.1,
) -> RangeImage:
    """Sample a range image by another number of pixels; the projection follows.

    method: 'mean' weighs the valid source pixels by their overlap with the output pixel where an axis shrinks
    and by linear interpolation where it grows; 'median' takes their weighted median; 'nearest' the one source
    pixel under the output pixel's centre.
    min_valid_share: an output pixel is NaN when no source pixel under it is valid, or less than this share.
    edge_ratio: where the sorted depths under an output pixel jump by more than this share of the nearer one,
    two surfaces meet; the mean is then taken over the one that covers more of the pixel, so that no depth
    appears between them. ``math.inf`` averages over edges.

    Columns of a full-circle Spherical wrap. A LaserRow stays one row, whatever the height. A mask keeps the
    pixels that it covers by half or more, and object and background depths are not mixed.
    Raises SettingsError for other methods, sizes and shares.
    """
    _check(method, min_valid_share, edge_ratio)
    rows = 1 if isinstance(image.projection, LaserRow) else height
    projection = image.projection.resized(width, rows)
    if (rows, width) == image.shape:
        return image
    if image.mask is None:
        ranges = _resampled(image.ranges_m, projection, method, min_valid_share, edge_ratio)
        return image.replace(ranges_m=ranges, projection=projection)
    mask = _resampled_mask(image.mask, projection, method)
    on = _resampled(
        np.where(image.mask, image.ranges_m, np.nan), projection, method, min_valid_share, edge_ratio
    )
    off = _resampled(
        np.where(image.mask, np.nan, image.ranges_m), projection, method, min_valid_share, edge_ratio
    )
    return image.replace(ranges_m=np.where(mask, on, off), projection=projection, mask=mask)


def fill_holes(values: npt.ArrayLike, *, wraps: bool = False) -> npt.NDArray[np.float32]:
    """Fill each NaN of a (height, width) array with the value of the nearest pixel that has one, as float32.

    ``wraps``: the last column lies beside the first. Raises DataError when no pixel is valid.
    """
    array = np.asarray(values, dtype=np.float32)
    if array.ndim != 2:
        raise DataError(f"fill_holes: expected a 2-D array, got shape {array.shape}")
    holes = ~np.isfinite(array)
    if not holes.any():
        return array.copy()
    if holes.all():
        raise DataError("fill_holes: expected at least one valid pixel, got none")
    from scipy.ndimage import distance_transform_edt

    pad = array.shape[1] if wraps else 0
    padded = np.pad(holes, ((0, 0), (pad, pad)), mode="wrap")
    rows, columns = distance_transform_edt(padded, return_distances=False, return_indices=True)
    window = slice(pad, pad + array.shape[1])
    filled: npt.NDArray[np.float32] = array[rows[:, window], (columns[:, window] - pad) % array.shape[1]]
    return filled


def _check(method: str, min_valid_share: float, edge_ratio: float) -> None:
    if method not in ("mean", "median", "nearest"):
        raise SettingsError(f"resample: expected method 'mean', 'median' or 'nearest', got {method!r}")
    if not 0 <= min_valid_share <= 1:
        raise SettingsError(f"resample: expected min_valid_share in [0, 1], got {min_valid_share}")
    if not edge_ratio > 0:
        raise SettingsError(f"resample: expected edge_ratio > 0, got {edge_ratio}")


def _resampled(
    ranges_m: npt.NDArray[np.float32],
    projection: Projection,
    method: Method,
    min_valid_share: float,
    edge_ratio: float,
) -> npt.NDArray[np.float32]:
    height, width = projection.height, projection.width
    if method == "nearest":
        return _nearest(ranges_m, height, width)
    from depthprint._kernels.rasterization import resample_footprints

    row_start, row_weights = _footprints(ranges_m.shape[0], height)
    column_start, column_weights = _footprints(ranges_m.shape[1], width)
    resampled: npt.NDArray[np.float32] = resample_footprints(
        np.ascontiguousarray(ranges_m, dtype=np.float32),
        row_start,
        row_weights,
        column_start,
        column_weights,
        isinstance(projection, Spherical) and projection.wraps,
        float(min_valid_share),
        float(edge_ratio),
        method == "median",
    )
    return resampled


def _resampled_mask(
    mask: npt.NDArray[np.bool_], projection: Projection, method: Method
) -> npt.NDArray[np.bool_]:
    if method == "nearest":
        return _nearest(mask, projection.height, projection.width)
    # The kernel skips NaN, so shares are averaged as 1 (off) and 2 (on) over edges.
    share = _resampled(mask.astype(np.float32) + 1, projection, "mean", 0.0, math.inf)
    return share >= 1.5


def _nearest(array: npt.NDArray[Any], height: int, width: int) -> npt.NDArray[Any]:
    rows = ((np.arange(height) + 0.5) * (array.shape[0] / height)).astype(np.int64)
    columns = ((np.arange(width) + 0.5) * (array.shape[1] / width)).astype(np.int64)
    return array[rows[:, None], columns[None, :]]


def _footprints(size: int, new_size: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """First source pixel (new_size,) and weights (new_size, k) of each output pixel along one axis."""
    scale = size / new_size
    centre = (np.arange(new_size) + 0.5) * scale
    reach = 0.5 * scale if scale >= 1 else 1.0
    start = np.floor(centre - reach + (0.0 if scale >= 1 else 0.5) + 1e-9).astype(np.int64)
    offsets = np.arange(math.ceil(2 * reach) + 1)
    pixels = start[:, None] + offsets
    if scale >= 1:
        low = np.maximum(pixels, (centre - reach)[:, None])
        high = np.minimum(pixels + 1, (centre + reach)[:, None])
        weights = np.maximum(high - low, 0.0)
    else:
        weights = np.maximum(1.0 - np.abs(pixels + 0.5 - centre[:, None]), 0.0)
    weights[weights < 1e-9] = 0.0
    return start, weights
