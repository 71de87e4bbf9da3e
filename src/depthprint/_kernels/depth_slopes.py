"""Slopes of depth along both axes, by a small filter that is a product of a bell and its own slope."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["depth_slopes"]

Float32Array = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]


@njit(cache=True, nogil=True)
def depth_slopes(
    padded: Float32Array, bell: FloatArray, slope: FloatArray
) -> tuple[Float32Array, Float32Array]:
    """Correlation (h, w) with the slope along x and the bell along y, and the other way round.

    padded: depth with a margin of half the filter's length.
    """
    size = len(bell)
    height, width = padded.shape[0] - size + 1, padded.shape[1] - size + 1
    along = np.zeros((height, width), dtype=np.float32)
    down = np.zeros((height, width), dtype=np.float32)
    bells, slopes = np.empty((2, padded.shape[1]))
    for r in range(height):
        bells[:] = 0.0
        slopes[:] = 0.0
        for k in range(size):
            row, b, s = padded[r + k], bell[k], slope[k]
            for c in range(len(row)):
                bells[c] += b * row[c]
                slopes[c] += s * row[c]
        for c in range(width):
            x = y = 0.0
            for k in range(size):
                x += slope[k] * bells[c + k]
                y += bell[k] * slopes[c + k]
            along[r, c] = x
            down[r, c] = y
    return along, down
