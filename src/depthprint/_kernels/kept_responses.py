"""Selection of descriptors by cells of a pyramid: each word keeps the one that responds most to it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["kept_means"]

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]


@njit(cache=True, nogil=True)
def kept_means(
    responses: FloatArray, columns: Float32Array, rows: Float32Array, levels: npt.NDArray[np.int64]
) -> FloatArray:
    """Mean response (cells, w) of the descriptors kept in each cell, levels and their cells row by row.

    responses: (m, w) of descriptors at places (m,) in [0, 1]. A descriptor belongs to the word that it responds to
    most; of those of a cell and word the first with the largest response is kept.
    """
    m, n_words = responses.shape
    n_cells = 0
    for n in levels:
        n_cells += n * n
    means = np.zeros((n_cells, n_words))
    nearest = np.zeros(m, dtype=np.int64)
    for k in range(m):
        row = responses[k]
        best = 0
        for w in range(1, n_words):
            if row[w] > row[best]:
                best = w
        nearest[k] = best
    kept = np.full(n_words, -1)
    first_cell = 0
    for n in levels:
        for cell in range(n * n):
            kept[:] = -1
            for k in range(m):
                column, row_number = min(int(columns[k] * n), n - 1), min(int(rows[k] * n), n - 1)
                if n * row_number + column != cell:
                    continue
                word = nearest[k]
                if kept[word] < 0 or responses[k, word] > responses[kept[word], word]:
                    kept[word] = k
            mean = means[first_cell + cell]
            count = 0
            for word in range(n_words):
                if kept[word] >= 0:
                    count += 1
                    response = responses[kept[word]]
                    for w in range(n_words):
                        mean[w] += response[w]
            for w in range(n_words):
                mean[w] /= max(count, 1)
        first_cell += n * n
    return means
