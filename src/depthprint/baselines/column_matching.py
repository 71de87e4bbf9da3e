"""Bird's-eye maps compared column by column at the best shift: what all Scan Context methods share."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["column_distances", "occupied_columns", "shift_columns", "unit_columns"]

Float32Array = npt.NDArray[np.float32]

_LANES = 8


def unit_columns(columns: Float32Array) -> Float32Array:
    """Columns (sectors, d) scaled to unit norm; an empty column stays zero."""
    norms = np.linalg.norm(columns, axis=1, keepdims=True)
    return np.where(norms > 1e-6, columns / np.maximum(norms, 1e-6), 0.0).astype(np.float32)


def occupied_columns(columns: Float32Array) -> Float32Array:
    """1 for a column (..., sectors, d) that holds something, else 0: (..., sectors)."""
    return np.asarray(columns.any(-1), dtype=np.float32)


def shift_columns(columns: Float32Array, shift: int, *, wraps: bool) -> Float32Array:
    """Columns (sectors, d) moved by ``shift``; those that come in from outside a limited view are empty."""
    moved = np.roll(columns, shift, axis=0)
    if not wraps:
        if shift > 0:
            moved[:shift] = 0.0
        elif shift < 0:
            moved[shift:] = 0.0
    return moved


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
    shifted = np.stack([shift_columns(query, int(s), wraps=wraps) for s in shifts])
    # BLAS takes whole lanes, and long rows from the left: seven shifts on that side cost twice as much as eight here.
    lanes = np.zeros((-(-len(shifts) // _LANES) * _LANES, rows.shape[1]), dtype=np.float32)
    lanes[: len(shifts)] = shifted.reshape(len(shifts), -1)
    cosines = (rows @ lanes.T).T[: len(shifts)]
    common = occupied_columns(shifted) @ occupied.T
    return np.asarray(1.0 - cosines / np.maximum(common, 1.0))
