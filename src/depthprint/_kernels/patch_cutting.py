"""Overlapping patches of a view as vectors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["cut_patches"]

Float32Array = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]


@njit(cache=True, nogil=True)
def cut_patches(
    channels: Float32Array, support: npt.NDArray[np.bool_], depth: Float32Array, ph: int, pw: int, step: int
) -> tuple[Float32Array, npt.NDArray[np.int64], FloatArray]:
    """Patches (m, c, ph * pw) of channels (c, h, w), row by row, how many of their pixels have support, mean depth.

    The mean is over the pixels with support. Patches without any are zero.
    """
    n_channels, height, width = channels.shape
    rows, columns = (height - ph) // step + 1, (width - pw) // step + 1
    vectors = np.zeros((rows * columns, n_channels, ph * pw), dtype=np.float32)
    covered = np.zeros(rows * columns, dtype=np.int64)
    mean_depth = np.zeros(rows * columns)
    for row in range(rows):
        for column in range(columns):
            patch, top, left = row * columns + column, row * step, column * step
            total = 0.0
            for r in range(ph):
                for c in range(pw):
                    if support[top + r, left + c]:
                        covered[patch] += 1
                        total += depth[top + r, left + c]
            if covered[patch] == 0:
                continue
            mean_depth[patch] = total / covered[patch]
            for channel in range(n_channels):
                for r in range(ph):
                    for c in range(pw):
                        vectors[patch, channel, r * pw + c] = channels[channel, top + r, left + c]
    return vectors, covered, mean_depth
