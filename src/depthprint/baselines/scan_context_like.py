"""Scan-Context-like: a polar map compared column by column, at the best shift of the columns.

In the manner of Kim & Kim, "Scan Context" (IROS 2018), written from the paper's idea; not their code.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

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
        columns = grid.reshape(-1, grid.shape[2]).T
        norms = np.linalg.norm(columns, axis=1, keepdims=True)
        return np.where(norms > 1e-6, columns / np.maximum(norms, 1e-6), 0.0).astype(np.float32)

    def add(self, description: npt.NDArray[np.float32]) -> int:
        """Store a place."""
        self._occupied.add(_occupied(description))
        return self._columns.add(description)

    def query(
        self, description: npt.NDArray[np.float32], k: int = 1, limit: int | None = None
    ) -> list[PlaceMatch]:
        """Nearest places, with the shift in sectors that brings the query onto them."""
        rows, occupied = self._columns.rows(limit), self._occupied.rows(limit)
        if not len(rows):
            return []
        distances = self._distances(description, rows, occupied)
        best = distances.argmin(0)
        return nearest_matches(distances.min(0), k, self._shifts[best].astype(np.float64))

    def distance(self, first: npt.NDArray[np.float32], second: npt.NDArray[np.float32]) -> float:
        """Mean cosine distance of the columns at the best shift."""
        if first.shape != second.shape:
            raise DataError(
                f"scan-context-like: expected maps of one shape, got {first.shape} and {second.shape}"
            )
        rows = second.reshape(1, -1)
        return float(self._distances(first, rows, _occupied(second)[None]).min())

    def _distances(
        self,
        query: npt.NDArray[np.float32],
        rows: npt.NDArray[np.float32],
        occupied: npt.NDArray[np.float32],
    ) -> npt.NDArray[np.float32]:
        """(shifts, n): one minus the mean cosine over the columns that hold something in both."""
        shifted = np.stack([self._shift(query, int(s)) for s in self._shifts])
        cosines = shifted.reshape(len(shifted), -1) @ rows.T
        common = _occupied(shifted) @ occupied.T
        return np.asarray(1.0 - cosines / np.maximum(common, 1.0))

    def _shift(self, columns: npt.NDArray[np.float32], shift: int) -> npt.NDArray[np.float32]:
        moved = np.roll(columns, shift, axis=0)
        if not self._polar.full_circle:
            if shift > 0:
                moved[:shift] = 0.0
            elif shift < 0:
                moved[shift:] = 0.0
        return moved


def _occupied(columns: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """1 for a column that holds something, else 0."""
    return np.asarray(columns.any(-1), dtype=np.float32)
