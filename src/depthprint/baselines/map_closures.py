"""Adapter for the package map-closures: ORB features matched between density images of the points seen from above.

The package is made for local maps of many scans joined by odometry. A recogniser here knows neither odometry nor poses,
so each frame is a local map of its own: its points, without any gathered before. That is less than it was made for.

Package: Gupta, Guadagnino, Mersch, Vizzo & Stachniss, "Effectively Detecting Loop Closures using Point Cloud Density
Maps", ICRA 2024.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import MissingExtraError, SettingsError
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch

__all__ = ["MapClosuresRecognizer"]

FloatArray = npt.NDArray[np.float64]

# The package takes maps of near numbers for one place and skips them: numbers this far apart are never near.
_ID_STEP = 10


class MapClosuresRecognizer:
    """One over the inliers of the best alignment; places without an alignment are not proposed.

    resolution_m, density_threshold, hamming_threshold, least_inliers: the package's own settings, its defaults but
        for the number of inliers: the protocol sweeps the threshold, so that few must pass also.

    The package stores a map as it queries with it: a query that is not added stays there unnamed, and is left out of
    all answers. Raises MissingExtraError where the package is not installed.
    """

    def __init__(
        self,
        *,
        resolution_m: float = 0.5,
        density_threshold: float = 0.05,
        hamming_threshold: int = 50,
        least_inliers: int = 3,
    ) -> None:
        if (
            not resolution_m > 0
            or not 0 <= density_threshold < 1
            or hamming_threshold < 1
            or least_inliers < 1
        ):
            raise SettingsError(
                "MapClosuresRecognizer: expected resolution_m > 0, density_threshold in [0, 1) and whole thresholds "
                f">= 1, got {resolution_m}, {density_threshold}, {hamming_threshold} and {least_inliers}"
            )
        self._options: dict[str, Any] = {
            "resolution_m": resolution_m,
            "density_threshold": density_threshold,
            "hamming_threshold": hamming_threshold,
            "least_inliers": least_inliers,
        }
        self._pipeline = _pipeline(resolution_m, density_threshold, hamming_threshold, least_inliers)
        self._place_of_id: dict[int, int] = {}
        self._next_id = 0
        self._latest: tuple[FloatArray, int] | None = None

    def fit(self, images: Sequence[RangeImage]) -> MapClosuresRecognizer:
        """Nothing to learn."""
        return self

    def describe(self, image: RangeImage) -> FloatArray:
        """Points (n, 3) float64 of one frame, metres, x forward, y left, z up."""
        points = image.require_returns().points_flu().reshape(-1, 3)
        return np.asarray(points[np.isfinite(points[:, 0])], dtype=np.float64)

    def add(self, description: FloatArray) -> int:
        """Store a place; where it was the last query, the package holds it already."""
        if self._latest is not None and self._latest[0] is description:
            number = self._latest[1]
        else:
            number, _ = self._closures(description, 1)
        self._latest = None
        self._place_of_id[number] = len(self._place_of_id)
        return len(self._place_of_id) - 1

    def query(self, description: FloatArray, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        """Places with the most inliers."""
        n = len(self._place_of_id) if limit is None else max(0, min(limit, len(self._place_of_id)))
        if not n:
            return []
        number, closures = self._closures(description, self._next_id // _ID_STEP + 1)
        self._latest = (description, number)
        found = []
        for closure in closures:
            place = self._place_of_id.get(int(closure.source_id))
            if place is not None and place < n:
                found.append(PlaceMatch(place, 1.0 / max(int(closure.number_of_inliers), 1)))
        return sorted(found, key=lambda match: (match.distance, match.place))[:k]

    def distance(self, first: FloatArray, second: FloatArray) -> float:
        """One over the inliers, were ``second`` the whole map; 1 where nothing aligns."""
        alone = MapClosuresRecognizer(**self._options)
        alone.add(second)
        matches = alone.query(first)
        return matches[0].distance if matches else 1.0

    def _closures(self, points: FloatArray, k: int) -> tuple[int, list[Any]]:
        number = self._next_id
        self._next_id += _ID_STEP
        return number, self._pipeline.get_top_k_closures(number, points, k)


def _pipeline(resolution_m: float, density_threshold: float, hamming: int, inliers: int) -> Any:
    try:
        from map_closures.config import MapClosuresConfig
        from map_closures.map_closures import MapClosures
    except ImportError as error:
        raise MissingExtraError(
            "method 'map-closures' needs the package map-closures: pip install 'depthprint[map-closures]'"
        ) from error
    return MapClosures(
        MapClosuresConfig(
            density_map_resolution=resolution_m,
            density_threshold=density_threshold,
            hamming_distance_threshold=hamming,
            inliers_threshold=inliers,
        )
    )
