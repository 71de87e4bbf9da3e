"""A growing matrix of vectors, searched by brute force: what every vector method stores its places in."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.recognizer import PlaceMatch

__all__ = ["VectorStore", "nearest_matches"]


class VectorStore:
    """Vectors of equal length in one float32 matrix that doubles when full."""

    def __init__(self) -> None:
        self._rows = np.empty((0, 0), dtype=np.float32)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, vector: npt.NDArray[np.float32]) -> int:
        """Append a vector and return its number."""
        flat = vector.reshape(-1)
        if self._count == len(self._rows):
            grown = np.empty((max(64, 2 * self._count), len(flat)), dtype=np.float32)
            if self._count:
                grown[: self._count] = self._rows
            self._rows = grown
        self._rows[self._count] = flat
        self._count += 1
        return self._count - 1

    def rows(self, limit: int | None = None) -> npt.NDArray[np.float32]:
        """The first ``limit`` vectors, (n, d)."""
        return self._rows[: self._count if limit is None else max(0, min(limit, self._count))]


def nearest_matches(
    distances: npt.NDArray[np.floating], k: int, shifts: npt.NDArray[np.floating] | None = None
) -> list[PlaceMatch]:
    """The k smallest distances as matches; ties go to the older place.

    distances: (n,), or (s, n) of which each place's least counts, at its value of ``shifts`` (s,).
    """
    least = distances if distances.ndim == 1 else distances.min(axis=0)
    within: npt.NDArray[np.int64] = np.arange(len(least))
    if k < len(least):
        within = np.flatnonzero(~(least > np.partition(least, k - 1)[k - 1]))
    chosen = within[np.argsort(least[within], kind="stable")[:k]]
    if shifts is None:
        return [PlaceMatch(int(i), float(least[i])) for i in chosen]
    at = shifts[distances[:, chosen].argmin(axis=0)]
    return [PlaceMatch(int(i), float(least[i]), float(shift)) for i, shift in zip(chosen, at, strict=True)]
