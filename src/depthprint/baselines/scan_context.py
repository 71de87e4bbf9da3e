"""Scan Context: the highest point of each polar cell, found by ring key, compared at the best turn of the columns.

Written from the paper, Kim & Kim, "Scan Context: Egocentric Spatial Descriptor for Place Recognition within 3D Point
Cloud Map", IROS 2018; not their code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from depthprint.baselines.column_matching import column_distances, occupied_columns, unit_columns
from depthprint.baselines.vector_store import VectorStore, nearest_matches
from depthprint.errors import SettingsError
from depthprint.polar_view import polar_view
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch
from depthprint.settings import PolarSettings

__all__ = ["ScanContext", "ScanContextRecognizer"]

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ScanContext:
    """columns: (sectors, rings) float32 unit columns. ring_key: (rings,) float32, share of occupied cells a ring."""

    columns: Float32Array
    ring_key: Float32Array


class ScanContextRecognizer:
    """Scan Context over 360 degrees or a limited field of view.

    sectors, rings, reach_m: the polar grid; the paper's is 60 x 20 out to 80 m, with the 'height' of the highest
        point above the ground. 'count' takes the log of the number of points instead: planar scans have one height.
    full_circle: sectors wrap and every shift is tried; otherwise up to ``max_shift`` columns to either side.
    candidates: places nearest by ring key that are compared in full; None compares all.
    """

    def __init__(
        self,
        *,
        sectors: int = 60,
        rings: int = 20,
        reach_m: float = 80.0,
        value: Literal["height", "count"] = "height",
        full_circle: bool = True,
        max_shift: int = 3,
        candidates: int | None = 50,
    ) -> None:
        if sectors < 1 or rings < 1 or not reach_m > 0 or max_shift < 0 or (candidates or 1) < 1:
            raise SettingsError(
                "ScanContextRecognizer: expected sectors, rings and candidates >= 1, reach_m > 0 and max_shift >= 0, "
                f"got {sectors}, {rings}, {candidates}, {reach_m} and {max_shift}"
            )
        self._polar = PolarSettings(
            sectors=sectors,
            rings=rings,
            ring_m=reach_m / rings,
            full_circle=full_circle,
            ground_clearance_m=0.0,
            max_height_m=100.0,
            smoothing=0.0,
        )
        self._value = value
        self._shifts = np.arange(sectors) if full_circle else np.arange(-max_shift, max_shift + 1)
        self._candidates = candidates
        self._columns, self._occupied, self._keys = VectorStore(), VectorStore(), VectorStore()

    def fit(self, images: Sequence[RangeImage]) -> ScanContextRecognizer:
        """Nothing to learn."""
        return self

    def describe(self, image: RangeImage) -> ScanContext:
        """Scan context and ring key of one frame."""
        image.require_returns()
        grid = polar_view(image, self._polar, (self._value,))[0]
        return ScanContext(unit_columns(grid.T), np.asarray((grid > 0).mean(axis=1), dtype=np.float32))

    def add(self, description: ScanContext) -> int:
        """Store a place."""
        self._occupied.add(occupied_columns(description.columns))
        self._keys.add(description.ring_key)
        return self._columns.add(description.columns)

    def query(self, description: ScanContext, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        """Nearest of the candidates by ring key, with the shift in sectors that brings the query onto each."""
        keys = self._keys.rows(limit)
        if not len(keys):
            return []
        chosen = self._nearest_keys(description.ring_key, keys, k)
        distances = column_distances(
            description.columns,
            self._columns.rows(limit)[chosen],
            self._occupied.rows(limit)[chosen],
            self._shifts,
            wraps=self._polar.full_circle,
        )
        found = nearest_matches(distances, k, self._shifts.astype(np.float64))
        return [PlaceMatch(int(chosen[m.place]), m.distance, m.shift) for m in found]

    def distance(self, first: ScanContext, second: ScanContext) -> float:
        """Mean cosine distance of the columns at the best shift."""
        rows, occupied = second.columns.reshape(1, -1), occupied_columns(second.columns)[None]
        wraps = self._polar.full_circle
        return float(column_distances(first.columns, rows, occupied, self._shifts, wraps=wraps).min())

    def _nearest_keys(self, key: Float32Array, keys: Float32Array, k: int) -> npt.NDArray[np.int64]:
        """Places to compare, oldest first."""
        if self._candidates is None or len(keys) <= max(k, self._candidates):
            return np.arange(len(keys))
        apart = ((keys - key) ** 2).sum(axis=1)
        return np.sort(np.argsort(apart, kind="stable")[: max(k, self._candidates)])
