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

_LANES = 8


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
        distances, shifts = self.distances(description, limit, sectors)
        return nearest_matches(distances, k, shifts)

    def distances(
        self, description: Encoding, limit: int | None = None, sectors: Sequence[int] | None = None
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
        """Distances (n,) to all places below ``limit``, and the shifts (n,) in sectors that give them."""
        rows = self._store.rows(limit)
        tried = self._sectors if sectors is None else sectors
        if not len(rows) or not len(tried):
            return np.empty(0, dtype=np.float32), np.empty(0)
        distances = self._distances(description, rows, tried)
        return distances.min(1), np.asarray(tried, dtype=np.float64)[distances.argmin(1)]

    def distance(self, first: Encoding, second: Encoding) -> float:
        """Distance of two encodings."""
        return float(self._distances(first, self._row(second)[None], self._sectors).min())

    def _row(self, description: Encoding) -> npt.NDArray[np.float32]:
        """All streams as one vector, in which a product with a moved query's is the weighted mean of the cosines."""
        return np.concatenate([unit_grid(vectors).reshape(-1) for vectors in description.vectors])

    def _distances(
        self, query: Encoding, rows: npt.NDArray[np.float32], sectors: Sequence[int]
    ) -> npt.NDArray[np.float32]:
        """Distances (n, shifts)."""
        from depthprint._kernels.blocks import one_blas_thread

        moved = []
        for grid, weight, step in zip(query.vectors, self._weights, self._step, strict=True):
            unit = np.float32(weight) * unit_grid(grid)
            moved.append([self._shift(unit, sector // step).reshape(-1) for sector in sectors])
        columns = np.concatenate([np.array(stream) for stream in moved], axis=1)
        # BLAS takes whole lanes: seven columns cost more than eight.
        padded = np.zeros((-(-len(columns) // _LANES) * _LANES, columns.shape[1]), dtype=np.float32)
        padded[: len(columns)] = columns
        with one_blas_thread():
            cosines = rows @ padded.T
        return np.asarray(1.0 - cosines[:, : len(columns)], dtype=np.float32)

    def _shift(self, grid: npt.NDArray[np.float32], places: int) -> npt.NDArray[np.float32]:
        moved = np.roll(grid, places, axis=0)
        if not self._wraps:
            if places > 0:
                moved[:places] = 0.0
            elif places < 0:
                moved[places:] = 0.0
        return moved
