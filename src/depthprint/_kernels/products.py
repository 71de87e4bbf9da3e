"""How few rows a matrix product may have while each row keeps the bits that it has in a full block."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from depthprint._kernels.blocks import one_blas_thread

__all__ = ["BLOCK_ROWS", "block_rows_for"]

BLOCK_ROWS = 256

_SMALLER = (2, 8, 16, 32, 64, 128)
_CHEAP_MULTIPLICATIONS = 1 << 18


def block_rows_for(n_rows: int, dtype: str, n_atoms: int, dimension: int) -> int:
    """Rows to pad n_rows to before they are multiplied by the (dimension, n_atoms) transpose of the atoms.

    BLAS rounds by a different order for some sizes of a product, and a model must not depend on which other
    signals came with it. So every product has ``BLOCK_ROWS`` rows, or fewer where a trial gave the same bits.
    """
    if n_rows >= BLOCK_ROWS or n_atoms * dimension * BLOCK_ROWS <= _CHEAP_MULTIPLICATIONS:
        return BLOCK_ROWS
    same = _rows_of_same_bits(dtype, n_atoms, dimension)
    return next((rows for rows in same if rows >= n_rows), BLOCK_ROWS)


@lru_cache(maxsize=64)
def _rows_of_same_bits(dtype: str, n_atoms: int, dimension: int) -> tuple[int, ...]:
    """Numbers of rows for which one signal, put in any row, has the bits that it has in any row of a full block."""
    rng = np.random.default_rng(0)
    atoms = rng.random((n_atoms, dimension), dtype=np.float32).astype(dtype, copy=False)
    atoms -= atoms.dtype.type(0.5)
    signal = (rng.random(dimension) - 0.5).astype(dtype)
    block = np.tile(signal, (BLOCK_ROWS, 1))
    with one_blas_thread():
        full = block @ atoms.T
        if (full != full[0]).any():
            return ()
        return tuple(rows for rows in _SMALLER if ((block[:rows] @ atoms.T) == full[0]).all())
