"""Partly hidden views of objects: queries of the protocols, and copies of views that a recogniser learns from too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from depthprint.errors import DataError, SettingsError
from depthprint.range_image import RangeImage

__all__ = ["LEARNED_SHARE", "hide_part", "partial_copies"]

# Share hidden in the copies that are learned from: more of it cost whole objects on training folds.
LEARNED_SHARE = 0.25

_COPY_SEED = 1
_MARGIN_PX = 2
_FEWEST_PIXELS = 16


def hide_part(image: RangeImage, share: float, rng: np.random.Generator) -> RangeImage:
    """Hide a share of the object behind a random half-plane, and crop anew around what is left.

    The line's direction is drawn evenly; it is placed so that ``share`` of the object's pixels lie beyond it. These
    leave the mask and become holes. Raises DataError for an image without mask, or one that would keep fewer than 16
    pixels; SettingsError for a share outside [0, 1).
    """
    if not 0 <= share < 1:
        raise SettingsError(f"hidden: expected a share in [0, 1), got {share}")
    if image.mask is None:
        raise DataError(
            f"{image.source or 'view'}: expected a mask of the object to hide a part of, got none"
        )
    rows, columns = np.nonzero(image.mask)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along = np.cos(angle) * columns + np.sin(angle) * rows
    kept = np.argsort(along, kind="stable")[: round(len(along) * (1.0 - share))]
    if len(kept) < _FEWEST_PIXELS:
        raise DataError(
            f"{image.source or 'view'}: expected {_FEWEST_PIXELS} pixels or more to stay, got {len(kept)}"
        )
    mask = np.zeros(image.shape, dtype=bool)
    mask[rows[kept], columns[kept]] = True
    ranges_m = np.where(image.mask & ~mask, np.nan, image.ranges_m)
    top, left = (max(0, int(axis[kept].min()) - _MARGIN_PX) for axis in (rows, columns))
    bottom = min(image.shape[0], int(rows[kept].max()) + 1 + _MARGIN_PX)
    right = min(image.shape[1], int(columns[kept].max()) + 1 + _MARGIN_PX)
    hidden = image.replace(ranges_m=ranges_m, mask=mask)
    return hidden.cropped(left, top, right - left, bottom - top)


def partial_copies(images: Sequence[RangeImage]) -> list[RangeImage]:
    """A copy of each pinhole view with a quarter of its object hidden, each with a seed of its own place.

    Without mask all that returned is the object. A view too small to hide anything of stays whole. Raises DataError
    for other than pinhole images.
    """
    return [
        _partial_copy(image, np.random.default_rng([_COPY_SEED, number]))
        for number, image in enumerate(images)
    ]


def _partial_copy(image: RangeImage, rng: np.random.Generator) -> RangeImage:
    seen = image.valid if image.mask is None else image.mask & image.valid
    if np.count_nonzero(seen) * (1.0 - LEARNED_SHARE) < _FEWEST_PIXELS:
        return image
    copy = hide_part(image if image.mask is not None else image.replace(mask=seen), LEARNED_SHARE, rng)
    if not (copy.valid & np.asarray(copy.mask)).any():
        return image
    return copy if image.mask is not None else copy.replace(mask=None)
