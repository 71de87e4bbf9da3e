"""Dual coordinate descent of squared-hinge support vector machines, many classes side by side."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["descend_block"]

Float32Array = npt.NDArray[np.float32]


@njit(cache=True, nogil=True)
def descend_block(
    gram: Float32Array,
    scores: Float32Array,
    signs: Float32Array,
    multipliers: Float32Array,
    ridge: float,
    worst: Float32Array,
) -> None:
    """Pass once over the rows of a block, one after another, every class for itself.

    gram: (b, b) of the block. scores: (b, c) at the start, kept up to date. signs: (b, c) +1 or -1. multipliers:
    (b, c) signed dual variables, updated. ridge: 1 / (2 C). worst: (c,) largest violation met, updated.
    """
    b, c = scores.shape
    steps = np.empty(c, dtype=np.float32)
    for i in range(b):
        curvature = gram[i, i] + ridge
        for k in range(c):
            sign = signs[i, k]
            alpha = sign * multipliers[i, k]
            gradient = sign * scores[i, k] - 1.0 + ridge * alpha
            violation = abs(gradient) if alpha > 0.0 else max(-gradient, 0.0)
            worst[k] = max(worst[k], np.float32(violation))
            moved = max(alpha - gradient / curvature, 0.0)
            steps[k] = np.float32(sign * (moved - alpha))
            multipliers[i, k] = np.float32(sign * moved)
        for j in range(b):
            near = gram[i, j]
            for k in range(c):
                scores[j, k] += near * steps[k]
