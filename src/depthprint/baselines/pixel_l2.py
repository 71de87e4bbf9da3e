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

_SPARE = 16


def pixel_vector(image: RangeImage, size: int = 96, smoothing: float = 2.0) -> npt.NDArray[np.float32]:
    """Depth in metres at size x size (one row for a planar scan), holes filled, smoothed, as a vector."""
    from scipy.ndimage import gaussian_filter

    image.require_returns()
    rows = 1 if image.projection.height == 1 else size
    depth = fill_holes(resample(image, size, rows).ranges_m).astype(np.float64)
    sigma = (0.0, smoothing) if rows == 1 else smoothing
    return np.asarray(gaussian_filter(depth, sigma), dtype=np.float32).reshape(-1)


class PixelL2Recognizer:
    """Euclidean distance between smoothed depth images; nothing is learned.

    ``centred`` takes each image's mean depth away first, so that a step towards the scene costs little.
    """

    def __init__(self, size: int = 96, *, centred: bool = False) -> None:
        self._size = size
        self._centred = centred
        self._store = VectorStore()
        self._squares: list[float] = []

    def fit(self, images: Sequence[RangeImage]) -> PixelL2Recognizer:
        """Nothing to learn."""
        return self

    def describe(self, image: RangeImage) -> npt.NDArray[np.float32]:
        """Smoothed depth as a vector."""
        vector = pixel_vector(image, self._size)
        return vector - vector.mean() if self._centred else vector

    def add(self, description: npt.NDArray[np.float32]) -> int:
        """Store a place."""
        self._squares.append(float(description @ description))
        return self._store.add(description)

    def query(
        self, description: npt.NDArray[np.float32], k: int = 1, limit: int | None = None
    ) -> list[PlaceMatch]:
        """Nearest places by root mean square difference of depth, in metres."""
        rows = self._store.rows(limit)
        if not len(rows):
            return []
        # |a|^2 - 2ab + |b|^2 loses small distances in the rounding of float32: it chooses, differences decide.
        rough = np.asarray(self._squares[: len(rows)]) - 2.0 * (rows @ description)
        chosen = np.sort(np.argsort(rough, kind="stable")[: k + _SPARE])
        exact = np.array([self.distance(rows[place], description) for place in chosen])
        best = nearest_matches(exact, k)
        return [PlaceMatch(int(chosen[match.place]), match.distance) for match in best]

    def distance(self, first: npt.NDArray[np.float32], second: npt.NDArray[np.float32]) -> float:
        """Root mean square difference in metres."""
        return float(np.sqrt(np.mean((first - second) ** 2)))
