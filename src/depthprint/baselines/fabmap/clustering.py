"""Modified sequential clustering: words that are no nearer to each other than a given size."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = ["nearest_centres", "sequential_clusters"]

Float32Array = npt.NDArray[np.float32]

_CHUNK = 1024


def sequential_clusters(
    descriptors: Float32Array, cluster_size: float, progress: Callable[[int, int], None] | None = None
) -> Float32Array:
    """Cluster centres (k, d) of descriptors (n, d) by modified sequential clustering.

    A descriptor farther than ``cluster_size`` from every centre so far becomes a centre; then all descriptors go to
    their nearest centre, and each centre becomes the mean of what came to it. The order of the descriptors
    matters; equal input gives equal words. Raises DataError without descriptors, SettingsError for a size <= 0.

    Source: Teynor & Burkhardt's MSC as used by FAB-MAP (Cummins & Newman, IJRR 2008, section on the vocabulary).
    """
    if descriptors.ndim != 2 or not len(descriptors):
        raise DataError(f"sequential_clusters: expected descriptors (n, d), n >= 1, got {descriptors.shape}")
    if not cluster_size > 0:
        raise SettingsError(f"sequential_clusters: expected cluster_size > 0, got {cluster_size}")
    centres: Float32Array = np.empty((0, descriptors.shape[1]), dtype=np.float32)
    for start in range(0, len(descriptors), _CHUNK):
        chunk = descriptors[start : start + _CHUNK]
        far = chunk
        if len(centres):
            far = chunk[_squared_distances(chunk, centres).min(axis=1) > cluster_size**2]
        centres = np.concatenate([centres, _greedy(far, cluster_size)])
        if progress is not None:
            progress(min(start + _CHUNK, len(descriptors)), len(descriptors))
    nearest = nearest_centres(descriptors, centres)
    # a centre that has lost all its members to later ones has no mean, and goes
    counts = np.bincount(nearest, minlength=len(centres))
    sums = np.zeros(centres.shape, dtype=np.float64)
    np.add.at(sums, nearest, descriptors)
    return np.asarray(sums[counts > 0] / counts[counts > 0, None], dtype=np.float32)


def nearest_centres(descriptors: Float32Array, centres: Float32Array) -> npt.NDArray[np.int64]:
    """Index (n,) of the centre nearest to each descriptor; ties go to the first."""
    nearest = [
        _squared_distances(descriptors[start : start + _CHUNK], centres).argmin(axis=1)
        for start in range(0, len(descriptors), _CHUNK)
    ]
    return np.concatenate(nearest) if nearest else np.empty(0, dtype=np.int64)


def _greedy(candidates: Float32Array, cluster_size: float) -> Float32Array:
    """Of candidates far from all earlier centres, those that are far from each other, first come first."""
    open_ = np.ones(len(candidates), dtype=bool)
    chosen = []
    while open_.any():
        first = int(np.argmax(open_))
        chosen.append(first)
        open_ &= _squared_distances(candidates, candidates[first : first + 1])[:, 0] > cluster_size**2
        open_[: first + 1] = False
    return candidates[chosen]


def _squared_distances(rows: Float32Array, centres: Float32Array) -> Float32Array:
    squares = np.einsum("ij,ij->i", rows, rows)[:, None] + np.einsum("ij,ij->i", centres, centres)
    return np.asarray(squares - 2.0 * (rows @ centres.T), dtype=np.float32)
