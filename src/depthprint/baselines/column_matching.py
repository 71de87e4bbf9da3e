"""Maps compared column by column at shifts: what all Scan Context methods share, and the cosine of coded columns."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = [
    "column_distances",
    "occupied_columns",
    "products_with_rows",
    "shifted_columns",
    "unit_columns",
]

Float32Array = npt.NDArray[np.float32]

_LANES = 8


def unit_columns(columns: Float32Array) -> Float32Array:
    """Columns (sectors, d) scaled to unit norm; an empty column stays zero."""
    norms = np.linalg.norm(columns, axis=1, keepdims=True)
    return np.where(norms > 1e-6, columns / np.maximum(norms, 1e-6), 0.0).astype(np.float32)


def occupied_columns(columns: Float32Array) -> Float32Array:
    """1 for a column (..., sectors, d) that holds something, else 0: (..., sectors)."""
    return np.asarray(columns.any(-1), dtype=np.float32)


def shifted_columns(columns: Float32Array, shifts: npt.NDArray[np.int64], *, wraps: bool) -> Float32Array:
    """Columns (w, d) moved by each of some shifts, (s, w, d); those that come in from outside a limited view are 0."""
    width = len(columns)
    source = np.arange(width) - shifts[:, None]
    moved = columns[source % width]
    if not wraps:
        moved[(source < 0) | (source >= width)] = 0.0
    return np.asarray(moved)


def products_with_rows(vectors: Float32Array, rows: Float32Array) -> Float32Array:
    """Inner products (s, n) of a few vectors (s, d) with many rows (n, d)."""
    # BLAS takes whole lanes, and long rows from the left: seven vectors on that side cost twice as much as eight here.
    lanes = np.zeros((-(-len(vectors) // _LANES) * _LANES, rows.shape[1]), dtype=np.float32)
    lanes[: len(vectors)] = vectors
    return np.asarray((rows @ lanes.T).T[: len(vectors)])


def column_distances(
    query: Float32Array,
    rows: Float32Array,
    occupied: Float32Array,
    shifts: npt.NDArray[np.int64],
    *,
    wraps: bool,
) -> Float32Array:
    """(shifts, n): one minus the mean cosine over the columns that hold something in both.

    query: (sectors, d) unit columns. rows: (n, sectors * d) of the places. occupied: (n, sectors).
    """
    shifted = shifted_columns(query, shifts, wraps=wraps)
    cosines = products_with_rows(shifted.reshape(len(shifts), -1), rows)
    common = occupied_columns(shifted) @ occupied.T
    return np.asarray(1.0 - cosines / np.maximum(common, 1.0))
