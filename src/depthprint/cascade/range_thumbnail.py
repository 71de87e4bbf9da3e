"""Range thumbnails: frames at a few pixels, compared without their mean ranges at the best of a few small shifts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.baselines.vector_store import VectorStore
from depthprint.errors import DataError
from depthprint.projection import LaserRow, Spherical
from depthprint.range_image import RangeImage
from depthprint.resampling import fill_holes, resample

__all__ = ["RangeThumbnails", "range_thumbnail"]

Float32Array = npt.NDArray[np.float32]

_CAMERA_SHAPE, _SPINNING_SHAPE, _ROW_SHAPE = (12, 12), (2, 60), (1, 64)
# Shifts tried: pixels up or down in an image, to either side in an image and in a scan; on a full circle every second.
_DOWN, _ACROSS, _ACROSS_SCAN, _CIRCLE_STEP = 2, 2, 4, 2
_LEAST_VARIANCE = 1e-6


def range_thumbnail(image: RangeImage) -> Float32Array:
    """Ranges of a frame at a few pixels, (rows, columns) float32 metres, holes filled from the nearest return.

    Raises DataError, naming the frame, when it holds no return.
    """
    image.require_returns()
    projection = image.projection
    wraps = isinstance(projection, Spherical) and projection.wraps
    rows, columns = _CAMERA_SHAPE
    if isinstance(projection, LaserRow):
        rows, columns = _ROW_SHAPE
    elif wraps:
        rows, columns = _SPINNING_SHAPE
    small = resample(image.replace(mask=None), columns, rows, edge_ratio=np.inf)
    return fill_holes(small.ranges_m, wraps=wraps)


class RangeThumbnails:
    """Thumbnails of places in the order of ``add``, and the distances of another one to them.

    distance(x, y): the root of the variance of x - y over the sum of theirs, of the pixels that both show, and the
    least over small shifts of x: 0 for one shape at whatever distance, about 1 for two that have nothing in common.
    On a full circle (``wraps``) columns shift around.
    """

    def __init__(self, *, wraps: bool = False) -> None:
        self._wraps = wraps
        self._shape: tuple[int, int] | None = None
        self._shifts: list[tuple[int, int]] = []
        self._seen: Float32Array = np.empty((0, 0), dtype=np.float32)
        self._counts: Float32Array = np.empty(0, dtype=np.float32)
        self._rows, self._variances = VectorStore(), VectorStore()

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, thumbnail: Float32Array) -> int:
        """Store a place's thumbnail; DataError where its shape is not that of those before."""
        if self._shape is None:
            self._prepare(thumbnail.shape)
        self._require_shape(thumbnail)
        centred = (thumbnail - thumbnail.mean()).reshape(-1)
        means = self._seen @ centred / self._counts
        self._variances.add(self._seen @ centred**2 / self._counts - means**2)
        return self._rows.add(centred)

    def distances(self, thumbnail: Float32Array, limit: int | None = None) -> Float32Array:
        """Distances (n,) float32 to the places below ``limit``; DataError for another shape."""
        rows = self._rows.rows(limit)
        if not len(rows):
            return np.empty(0, dtype=np.float32)
        self._require_shape(thumbnail)
        centred = thumbnail - thumbnail.mean()
        moved = np.stack([self._moved(centred, *shift).reshape(-1) for shift in self._shifts])
        # Without its mean over what both show, the query's product with a place needs none of the place's.
        moved -= self._seen * (moved.sum(1) / self._counts)[:, None]
        own = (moved**2).sum(1) / self._counts
        moved *= (2.0 / self._counts)[:, None]
        from depthprint._kernels.blocks import one_blas_thread

        with one_blas_thread():
            alike = rows @ moved.T
        alike /= self._variances.rows(limit) + (own + np.float32(_LEAST_VARIANCE))
        return np.asarray(np.sqrt(np.maximum(1.0 - alike.max(1), 0.0)))

    def _prepare(self, shape: tuple[int, ...]) -> None:
        self._shape = (shape[0], shape[1])
        if self._wraps:
            self._shifts = [(0, x) for x in range(0, shape[1], _CIRCLE_STEP)]
        else:
            down, across = min(_DOWN, shape[0] // 4), _ACROSS_SCAN if shape[0] == 1 else _ACROSS
            self._shifts = [(y, x) for y in range(-down, down + 1) for x in range(-across, across + 1)]
        ones = np.ones(self._shape, dtype=np.float32)
        self._seen = np.stack([self._moved(ones, *shift).reshape(-1) for shift in self._shifts])
        self._counts = self._seen.sum(1)

    def _moved(self, thumbnail: Float32Array, down: int, across: int) -> Float32Array:
        """The thumbnail moved, 0 where nothing came in."""
        moved = np.roll(thumbnail, (down, across), axis=(0, 1))
        if not self._wraps:
            moved[_came_in(down)] = 0.0
            moved[:, _came_in(across)] = 0.0
        return moved

    def _require_shape(self, thumbnail: Float32Array) -> None:
        if thumbnail.shape != self._shape:
            raise DataError(
                f"thumbnail: expected one of shape {self._shape} as those before, got {thumbnail.shape}: "
                "were the frames taken by one sensor?"
            )


def _came_in(shift: int) -> slice:
    """Rows or columns that a shift brings in from outside."""
    return slice(0, shift) if shift >= 0 else slice(shift, None)
