"""Queries of the object protocols that are not one whole view: several views of a turn, and partly hidden objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import ObjectView
from depthprint.errors import DataError, SettingsError
from depthprint.range_image import RangeImage

__all__ = ["hide_part", "turn_queries"]

IndexArray = npt.NDArray[np.int64]

_MARGIN_PX = 2
_FEWEST_PIXELS = 16


def turn_queries(views: Sequence[ObjectView], test: IndexArray, n_views: int) -> IndexArray:
    """Number the views of each query: ``n_views`` consecutive ones of a turn, as a moving camera has them.

    One query begins at each view of ``test``; after the last frame of a turn comes its first. Returns
    (len(test), n_views) positions within ``test``. Raises DataError when a tested turn is shorter than that.
    """
    if n_views < 1:
        raise SettingsError(f"views: expected 1 or more views a query, got {n_views}")
    turns: dict[tuple[str, int], list[int]] = {}
    for position, number in enumerate(test):
        view = views[number]
        turns.setdefault((view.instance, view.video), []).append(position)
    queries = np.empty((len(test), n_views), dtype=np.int64)
    for (instance, video), positions in turns.items():
        if len(positions) < n_views:
            raise DataError(
                f"{instance}, video {video}: expected {n_views} views or more in each turn, "
                f"got {len(positions)}"
            )
        turn = np.array(sorted(positions, key=lambda p: views[int(test[p])].frame))
        for start in range(len(turn)):
            queries[turn[start]] = turn[(start + np.arange(n_views)) % len(turn)]
    return queries


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
