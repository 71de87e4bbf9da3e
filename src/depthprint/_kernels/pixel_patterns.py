"""What each pixel's eight neighbours are to it: which lie at least as far, and how much all nine differ."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["pixel_patterns"]

Float32Array = npt.NDArray[np.float32]


@njit(cache=True, nogil=True)
def pixel_patterns(padded: Float32Array) -> tuple[npt.NDArray[np.int32], Float32Array]:
    """Number of each pixel's pattern, neighbours row by row from the highest bit, and the deviation of the nine.

    padded: depth with a margin of one pixel; numbers and deviation are (h, w) without it.
    """
    height, width = padded.shape[0] - 2, padded.shape[1] - 2
    numbers = np.zeros((height, width), dtype=np.int32)
    deviation = np.zeros((height, width), dtype=np.float32)
    for r in range(height):
        for c in range(width):
            centre = padded[r + 1, c + 1]
            number = 0
            total = np.float64(centre)
            flat = True
            for i in range(3):
                for j in range(3):
                    if i == 1 and j == 1:
                        continue
                    depth = padded[r + i, c + j]
                    number = 2 * number + (1 if depth >= centre else 0)
                    flat = flat and depth == centre
                    total += np.float64(depth)
            numbers[r, c] = number
            if flat:
                continue
            mean = total / 9
            squares = 0.0
            for i in range(3):
                for j in range(3):
                    squares += (np.float64(padded[r + i, c + j]) - mean) ** 2
            deviation[r, c] = math.sqrt(squares / 8)
    return numbers, deviation
