"""Cosine of the same coded clusters, at the best shift: what the EMD must beat to earn its cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.baselines.column_matching import products_with_rows, shifted_columns
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
        self._store = VectorStore()

    def fit(self, images: Sequence[RangeImage]) -> CosineRecognizer:
        """Learn the encoder's dictionaries and forget all places."""
        self._encoder.fit(images)
        self._store = VectorStore()
        return self

    def describe(self, image: RangeImage) -> Encoding:
        """Encode one frame."""
        return self._encoder.describe(image)

    def add(self, description: Encoding) -> int:
        """Store a place."""
        return self._store.add(self._row(description))

    def query(
        self,
        description: Encoding,
        k: int = 1,
        limit: int | None = None,
        sectors: Sequence[int] | None = None,
    ) -> list[PlaceMatch]:
        """Nearest places with the shift in sectors; ``sectors``: shifts to try in place of the encoder's."""
        tried = self._sectors if sectors is None else sectors
        distances = self.distances(description, limit, tried)
        return nearest_matches(distances, k, np.asarray(tried, dtype=np.float64)) if distances.size else []

    def distances(
        self, description: Encoding, limit: int | None = None, sectors: Sequence[int] | None = None
    ) -> npt.NDArray[np.float32]:
        """Distances (shifts, n) to all places below ``limit``, at the encoder's shifts or those given."""
        rows = self._store.rows(limit)
        tried = self._sectors if sectors is None else sectors
        if not len(rows) or not len(tried):
            return np.empty((len(tried), len(rows)), dtype=np.float32)
        return self._distances(description, rows, tried)

    def distance(self, first: Encoding, second: Encoding) -> float:
        """Distance of two encodings."""
        return float(self._distances(first, self._row(second)[None], self._sectors).min())

    def _row(self, description: Encoding) -> npt.NDArray[np.float32]:
        """All streams as one vector, in which a product with a moved query's is the weighted mean of the cosines."""
        return np.concatenate([unit_grid(vectors).reshape(-1) for vectors in description.vectors])

    def _distances(
        self, query: Encoding, rows: npt.NDArray[np.float32], sectors: Sequence[int]
    ) -> npt.NDArray[np.float32]:
        """Distances (shifts, n)."""
        from depthprint._kernels.blocks import one_blas_thread

        parts = []
        for grid, weight, step in zip(query.vectors, self._weights, self._step, strict=True):
            places = np.asarray(sectors, dtype=np.int64) // step
            moved = shifted_columns(np.float32(weight) * unit_grid(grid), places, wraps=self._wraps)
            parts.append(moved.reshape(len(sectors), -1))
        with one_blas_thread():
            cosines = products_with_rows(np.concatenate(parts, axis=1), rows)
        return np.asarray(np.float32(1.0) - np.ascontiguousarray(cosines))
