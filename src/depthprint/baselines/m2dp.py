"""M2DP: a point cloud projected on many planes, counted in polar cells, and summed up by its first singular vectors.

Written from the paper, He, Wang & Zhang, "M2DP: A Novel 3D Point Cloud Descriptor and Its Application in Loop
Closure Detection", IROS 2016.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.baselines.vector_store import VectorStore, nearest_matches
from depthprint.errors import DataError, SettingsError
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch

__all__ = ["M2dpRecognizer", "m2dp_descriptors"]

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

# The principal axes have no sign of their own: half turns about each of them give four equal readings of a cloud.
_SIGNS = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))


def m2dp_descriptors(
    points: npt.ArrayLike, *, azimuths: int = 4, elevations: int = 16, circles: int = 8, sectors: int = 16
) -> Float32Array:
    """Descriptors (4, azimuths * elevations + circles * sectors) float32 of a cloud (n, 3), one for each reading.

    The cloud is centred and turned onto its principal axes; on each of azimuths * elevations planes through the
    centroid, points are counted in polar cells whose radii grow as squares; the matrix of counts, one plane a row, is
    summed up by its first left and right singular vectors. Rows differ by the signs of the first two axes.
    Raises DataError for fewer than three points or any that is not finite.
    """
    cloud = np.asarray(points, dtype=np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3 or len(cloud) < 3 or not np.isfinite(cloud).all():
        raise DataError(f"m2dp: expected three or more finite points (n, 3), got shape {cloud.shape}")
    centred = cloud - cloud.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    along = centred @ axes[:, ::-1][:, :2]
    up = centred @ np.cross(axes[:, 2], axes[:, 1])
    x_axes, y_axes = _planes(azimuths, elevations)
    reach = np.float32(max(float(np.linalg.norm(centred, axis=1).max()), 1e-9))
    readings = []
    for first, second in _SIGNS:
        turned = np.stack([first * along[:, 0], second * along[:, 1], first * second * up], axis=1)
        # half the width is twice as fast, and cell edges are arbitrary
        counts = _counts(
            (turned @ x_axes.T).astype(np.float32),
            (turned @ y_axes.T).astype(np.float32),
            reach,
            circles,
            sectors,
        )
        left, _, right = np.linalg.svd(counts, full_matrices=False)
        # counts are not negative, so neither are the first singular vectors, but for a common sign
        readings.append(np.concatenate([np.abs(left[:, 0]), np.abs(right[0])]))
    return np.asarray(readings, dtype=np.float32)


class M2dpRecognizer:
    """Euclidean distance of M2DP descriptors, least over the query's four readings.

    most_points: a frame is thinned evenly to this many. normal and plane numbers as in ``m2dp_descriptors``.
    """

    def __init__(
        self,
        *,
        most_points: int = 4096,
        azimuths: int = 4,
        elevations: int = 16,
        circles: int = 8,
        sectors: int = 16,
        reach_m: float = math.inf,
    ) -> None:
        if min(most_points, azimuths, elevations, circles, sectors) < 1 or not reach_m > 0:
            raise SettingsError("M2dpRecognizer: expected every number >= 1 and reach_m > 0")
        self._most_points = most_points
        self._reach_m = reach_m
        self._shape = {
            "azimuths": azimuths, "elevations": elevations, "circles": circles, "sectors": sectors,
        }  # fmt: skip
        self._store = VectorStore()

    def fit(self, images: Sequence[RangeImage]) -> M2dpRecognizer:
        """Nothing to learn."""
        return self

    def describe(self, image: RangeImage) -> Float32Array:
        """Descriptors (4, d) of one frame's points."""
        points = image.require_returns().points_flu().reshape(-1, 3)
        points = points[np.isfinite(points[:, 0])]
        points = points[np.linalg.norm(points, axis=1) <= self._reach_m]
        step = max(1, math.ceil(len(points) / self._most_points))
        try:
            return m2dp_descriptors(points[::step], **self._shape)
        except DataError as error:
            raise DataError(f"{image.source or 'RangeImage'}: {error}") from error

    def add(self, description: Float32Array) -> int:
        """Store a place by its first reading."""
        return self._store.add(description[0])

    def query(self, description: Float32Array, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        """Nearest places."""
        rows = self._store.rows(limit)
        if not len(rows):
            return []
        apart = [np.linalg.norm(rows - reading, axis=1) for reading in description]
        return nearest_matches(np.min(apart, axis=0), k)

    def distance(self, first: Float32Array, second: Float32Array) -> float:
        """Distance of the nearest reading of ``first`` to the first of ``second``."""
        return float(np.linalg.norm(first - second[0], axis=1).min())


def _planes(azimuths: int, elevations: int) -> tuple[FloatArray, FloatArray]:
    """On each plane the projected x axis and the axis across it, (planes, 3) both."""
    azimuth = np.arange(azimuths) * math.pi / azimuths
    elevation = np.arange(elevations) * math.pi / (2 * elevations)
    a, e = (grid.ravel() for grid in np.meshgrid(azimuth, elevation, indexing="ij"))
    normals = np.stack([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)], axis=1)
    x_axes = np.array([1.0, 0.0, 0.0]) - normals[:, :1] * normals
    lengths = np.linalg.norm(x_axes, axis=1, keepdims=True)
    # the plane across x itself has no projected x axis; z serves there
    x_axes = np.where(lengths > 1e-9, x_axes / np.maximum(lengths, 1e-9), [0.0, 0.0, 1.0])
    return x_axes, np.cross(normals, x_axes)


def _counts(x: Float32Array, y: Float32Array, reach: np.float32, circles: int, sectors: int) -> FloatArray:
    """Share of the points (n, planes) in each polar cell: (planes, circles * sectors)."""
    n, planes = x.shape
    # circles at r, 4 r, 9 r ... out to the farthest point
    circle = np.minimum((np.sqrt(np.hypot(x, y) / reach) * circles).astype(np.int32), circles - 1)
    sector = np.floor(np.arctan2(y, x) * (sectors / (2 * math.pi))).astype(np.int32) % sectors
    cell = np.arange(planes, dtype=np.int32) * (circles * sectors) + circle * sectors + sector
    counts = np.bincount(cell.ravel(), minlength=planes * circles * sectors)
    return counts.reshape(planes, circles * sectors) / n
