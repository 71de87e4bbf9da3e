"""Max-pooling of sparse codes over overlapping cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["cell_means", "max_pool_cells"]


@njit(cache=True, nogil=True)
def max_pool_cells(
    indptr: npt.NDArray[np.int64],
    indices: npt.NDArray[np.int32],
    coefficients: npt.NDArray[np.float64],
    positions: npt.NDArray[np.float64],
    centres: npt.NDArray[np.float64],
    half_widths: npt.NDArray[np.float64],
    n_atoms: int,
    signed: bool,
) -> npt.NDArray[np.float64]:
    """Largest |coefficient| per atom and sign over the patches in each cell: (cells, 2 n_atoms)."""
    n_cells = len(centres)
    pooled = np.zeros((n_cells, 2 * n_atoms))
    for patch in range(len(indptr) - 1):
        for cell in range(n_cells):
            inside = True
            for axis in range(positions.shape[1]):
                if abs(positions[patch, axis] - centres[cell, axis]) > half_widths[cell]:
                    inside = False
            if not inside:
                continue
            for entry in range(indptr[patch], indptr[patch + 1]):
                value = coefficients[entry]
                slot = indices[entry]
                if value < 0:
                    value = -value
                    if signed:
                        slot += n_atoms
                if value > pooled[cell, slot]:
                    pooled[cell, slot] = value
    return pooled


@njit(cache=True, nogil=True)
def cell_means(
    indptr: npt.NDArray[np.int64],
    values: npt.NDArray[np.float64],
    positions: npt.NDArray[np.float64],
    centres: npt.NDArray[np.float64],
    half_widths: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Mean value of the patches with a code in each cell, (cells,); 0 where there are none."""
    means = np.zeros(len(centres))
    for cell in range(len(centres)):
        count = 0
        for patch in range(len(positions)):
            if indptr[patch] == indptr[patch + 1]:
                continue
            inside = True
            for axis in range(positions.shape[1]):
                if abs(positions[patch, axis] - centres[cell, axis]) > half_widths[cell]:
                    inside = False
            if inside:
                means[cell] += values[patch]
                count += 1
        means[cell] /= max(count, 1)
    return means
