"""Pixel L2: the plain comparison of depth images, set up well (holes filled, smoothed)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.baselines.vector_store import VectorStore, nearest_matches
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch
from depthprint.resampling import fill_holes, resample

__all__ = ["PixelL2Recognizer", "pixel_vector"]


def pixel_vector(image: RangeImage, size: int = 96, smoothing: float = 2.0) -> npt.NDArray[np.float32]:
    """Depth in metres at size x size (one row for a planar scan), holes filled, smoothed, as a vector."""
    from scipy.ndimage import gaussian_filter

    image.require_returns()
    rows = 1 if image.projection.height == 1 else size
    depth = fill_holes(resample(image, size, rows).ranges_m).astype(np.float64)
    sigma = (0.0, smoothing) if rows == 1 else smoothing
    return np.asarray(gaussian_filter(depth, sigma), dtype=np.float32).reshape(-1)


class PixelL2Recognizer:
    """Euclidean distance between smoothed depth images; nothing is learned."""

    def __init__(self, size: int = 96) -> None:
        self._size = size
        self._store = VectorStore()

    def fit(self, images: Sequence[RangeImage]) -> PixelL2Recognizer:
        """Nothing to learn."""
        return self

    def describe(self, image: RangeImage) -> npt.NDArray[np.float32]:
        """Smoothed depth as a vector."""
        return pixel_vector(image, self._size)

    def add(self, description: npt.NDArray[np.float32]) -> int:
        """Store a place."""
        return self._store.add(description)

    def query(
        self, description: npt.NDArray[np.float32], k: int = 1, limit: int | None = None
    ) -> list[PlaceMatch]:
        """Nearest places by root mean square difference of depth, in metres."""
        rows = self._store.rows(limit)
        if not len(rows):
            return []
        # Differences, not |a|^2 - 2ab + |b|^2, which loses a small distance in the rounding of float32.
        return nearest_matches(np.array([self.distance(row, description) for row in rows]), k)

    def distance(self, first: npt.NDArray[np.float32], second: npt.NDArray[np.float32]) -> float:
        """Root mean square difference in metres."""
        return float(np.sqrt(np.mean((first - second) ** 2)))
