"""Scan-Context-like: a polar map compared column by column, at the best shift of the columns.

In the manner of Kim & Kim, "Scan Context" (IROS 2018), written from the paper's idea; not their code.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.baselines.column_matching import column_distances, occupied_columns, unit_columns
from depthprint.baselines.vector_store import VectorStore, nearest_matches
from depthprint.errors import DataError
from depthprint.polar_view import polar_view
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch
from depthprint.settings import PolarSettings

__all__ = ["ScanContextLikeRecognizer"]


class ScanContextLikeRecognizer:
    """Mean cosine distance of a polar map's columns, least over shifts.

    channels: polar channels stacked in each column, each scaled to equal energy by ``fit``'s absence of learning:
        a channel is divided by its own norm over the map.
    max_shift: columns to either side for a limited field of view; every shift on a full circle.
    """

    def __init__(
        self, polar: PolarSettings, channels: tuple[str, ...] = ("height",), max_shift: int = 3
    ) -> None:
        self._polar = polar
        self._channels = channels
        if polar.full_circle:
            self._shifts = np.arange(polar.sectors)
        else:
            self._shifts = np.arange(-max_shift, max_shift + 1)
        self._columns = VectorStore()
        self._occupied = VectorStore()

    def fit(self, images: Sequence[RangeImage]) -> ScanContextLikeRecognizer:
        """Nothing to learn."""
        return self

    def describe(self, image: RangeImage) -> npt.NDArray[np.float32]:
        """Polar map as unit columns, (sectors, channels * rings) float32; an empty column is zero."""
        image.require_returns()
        grid = polar_view(image, self._polar, self._channels)
        grid = grid / np.maximum(np.linalg.norm(grid, axis=(1, 2), keepdims=True), 1e-9)
        return unit_columns(grid.reshape(-1, grid.shape[2]).T)

    def add(self, description: npt.NDArray[np.float32]) -> int:
        """Store a place."""
        self._occupied.add(occupied_columns(description))
        return self._columns.add(description)

    def query(
        self, description: npt.NDArray[np.float32], k: int = 1, limit: int | None = None
    ) -> list[PlaceMatch]:
        """Nearest places, with the shift in sectors that brings the query onto them."""
        distances = self.distances(description, limit)
        return nearest_matches(distances, k, self._shifts.astype(np.float64)) if distances.size else []

    def distances(
        self, description: npt.NDArray[np.float32], limit: int | None = None
    ) -> npt.NDArray[np.float32]:
        """Distances (shifts, n) to the places below ``limit``."""
        rows, occupied = self._columns.rows(limit), self._occupied.rows(limit)
        if not len(rows):
            return np.empty((len(self._shifts), 0), dtype=np.float32)
        return column_distances(description, rows, occupied, self._shifts, wraps=self._polar.full_circle)

    def distance(self, first: npt.NDArray[np.float32], second: npt.NDArray[np.float32]) -> float:
        """Mean cosine distance of the columns at the best shift."""
        if first.shape != second.shape:
            raise DataError(
                f"scan-context-like: expected maps of one shape, got {first.shape} and {second.shape}"
            )
        rows = second.reshape(1, -1)
        occupied = occupied_columns(second)[None]
        wraps = self._polar.full_circle
        return float(column_distances(first, rows, occupied, self._shifts, wraps=wraps).min())
