"""Cosine of the same coded clusters, at the best shift: what the EMD must beat to earn its cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.baselines.vector_store import VectorStore, nearest_matches
from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch

__all__ = ["CosineRecognizer", "unit_grid"]


def unit_grid(grid: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Scale a stream's whole grid of clusters to unit norm."""
    return grid / max(float(np.linalg.norm(grid)), 1e-9)


class CosineRecognizer:
    """One minus the weighted mean of the streams' cosines, least over the shifts of a bird's-eye view."""

    def __init__(self, encoder: Encoder) -> None:
        self._encoder = encoder
        self._sectors = encoder.shift_sectors()
        self._wraps = encoder.settings.polar.full_circle
        self._step = [s.stride if s.view == "polar" else 1 for s in encoder.settings.streams]
        self._weights = encoder.settings.stream_weights
        self._stores = [VectorStore() for _ in self._weights]

    def fit(self, images: Sequence[RangeImage]) -> CosineRecognizer:
        """Learn the encoder's dictionaries and forget all places."""
        self._encoder.fit(images)
        self._stores = [VectorStore() for _ in self._weights]
        return self

    def describe(self, image: RangeImage) -> Encoding:
        """Encode one frame."""
        return self._encoder.describe(image)

    def add(self, description: Encoding) -> int:
        """Store a place."""
        for store, vectors in zip(self._stores, description.vectors, strict=True):
            number = store.add(unit_grid(vectors))
        return number

    def query(
        self,
        description: Encoding,
        k: int = 1,
        limit: int | None = None,
        sectors: Sequence[int] | None = None,
    ) -> list[PlaceMatch]:
        """Nearest places with the shift in sectors; ``sectors``: shifts to try in place of the encoder's."""
        rows = [store.rows(limit) for store in self._stores]
        tried = self._sectors if sectors is None else sectors
        if not len(rows[0]) or not len(tried):
            return []
        distances = self._distances(description, rows, tried)
        shifts = np.asarray(tried, dtype=np.float64)[distances.argmin(0)]
        return nearest_matches(distances.min(0), k, shifts)

    def distance(self, first: Encoding, second: Encoding) -> float:
        """Distance of two encodings."""
        rows = [unit_grid(vectors).reshape(1, -1) for vectors in second.vectors]
        return float(self._distances(first, rows, self._sectors).min())

    def _distances(
        self, query: Encoding, rows: Sequence[npt.NDArray[np.float32]], sectors: Sequence[int]
    ) -> npt.NDArray[np.floating]:
        total = np.zeros((len(sectors), len(rows[0])))
        for grid, stored, weight, step in zip(query.vectors, rows, self._weights, self._step, strict=True):
            unit = unit_grid(grid)
            moved = np.stack([self._shift(unit, sector // step).reshape(-1) for sector in sectors])
            total += weight * (1.0 - moved @ stored.T)
        return total

    def _shift(self, grid: npt.NDArray[np.float32], places: int) -> npt.NDArray[np.float32]:
        moved = np.roll(grid, places, axis=0)
        if not self._wraps:
            if places > 0:
                moved[:places] = 0.0
            elif places < 0:
                moved[places:] = 0.0
        return moved
