"""Points of single precision as an 8-bit code, which a sweep reads alone, and the 24 bits that are left.

An item has one scale s, and 2^e <= s < 2^(e + 1). A number of at least 2^e is code times s and a multiple of
2^(e - 23), a code being at most LINEAR. Smaller numbers take the other codes, which count as 0 in a sweep: one
for two powers of 2 and a sign, and the mantissa. What neither holds is refused.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.tiles import LANES

__all__ = ["LINEAR", "join_item", "split_items"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
ByteArray = npt.NDArray[np.uint8]

LINEAR = 107
_GROUPS_OF_SMALL = 127 - LINEAR
_MANTISSA = 1 << 23
_LEAST_SCALE = 1e-30  # its multiples are far from the end of single precision
_UP = 1.0 + 1e-6  # more than rounding to single precision takes away


@njit(cache=True, nogil=True)
def split_items(
    points: FloatArray,
    counts: IntArray,
    first: int,
    codes: ByteArray,
    rest: ByteArray,
    scales: Float32Array,
    errors: Float32Array,
) -> bool:
    """Codes, rests, scales and errors of items first.. from points (n, d, k); whether the rests hold all of them.

    codes (groups, k, quads, LANES, 4) are 128 more than the signed code. rest (items, d, k, 3), or (items, d, k,
    0) for codes alone. errors: no less than any point's distance from what its codes count as in a sweep.
    """
    exact = True
    wanted = rest.shape[3] > 0
    for n in range(len(points)):
        item = first + n
        group, lane = item // LANES, item % LANES
        largest = 0.0
        for k in range(points.shape[1]):
            for j in range(counts[n]):
                largest = max(largest, abs(points[n, k, j]))
        scales[item] = max(largest / LINEAR, _LEAST_SCALE)
        scale = np.float64(scales[item])
        exponent = math.frexp(scale)[1]  # of half the power of 2 under the scale
        power = math.ldexp(1.0, exponent - 1)
        unit = math.ldexp(1.0, exponent - 24)
        worst = 0.0
        codes[group, :, :, lane, :] = 128
        for j in range(counts[n]):
            square = 0.0
            for k in range(points.shape[1]):
                x = points[n, k, j]
                code, left, gap = np.int64(0), np.int64(0), x
                if abs(x) >= power:
                    code = np.int64(min(max(np.rint(x / scale), -LINEAR), LINEAR))
                    if code == 0:
                        code = np.int64(1 if x > 0.0 else -1)
                    gap = x - code * scale
                    if wanted:
                        left = np.int64(np.rint(gap / unit))
                        if left * unit != gap or left < -_MANTISSA or left >= _MANTISSA:
                            exact = False
                elif x != 0.0 and wanted:
                    fraction, height = math.frexp(abs(x))
                    below = exponent - 1 - height
                    mantissa = (2.0 * fraction - 1.0) * _MANTISSA
                    left = np.int64(mantissa)
                    if left != mantissa or below >= 2 * _GROUPS_OF_SMALL:
                        exact = False
                    left |= (below & 1) << 23
                    code = np.int64(LINEAR + 1 + min(below // 2, _GROUPS_OF_SMALL - 1))
                    if x < 0.0:
                        code = -code
                square += gap * gap
                codes[group, j, k // 4, lane, k % 4] = code + 128
                if wanted:
                    rest[item, k, j, 0] = left & 255
                    rest[item, k, j, 1] = (left >> 8) & 255
                    rest[item, k, j, 2] = (left >> 16) & 255
            worst = max(worst, square)
        errors[item] = np.sqrt(worst) * _UP
        if not exact:
            wanted = False
    return exact


@njit(cache=True, nogil=True)
def join_item(
    codes: ByteArray, rest: ByteArray, scales: Float32Array, item: int, count: int, out: Any
) -> None:
    """The points of an item into out (d, k), 0 beyond its clusters, as `split_items` was given them."""
    group, lane = item // LANES, item % LANES
    scale = np.float64(scales[item])
    exponent = math.frexp(scale)[1]
    unit = math.ldexp(1.0, exponent - 24)
    out[:, count:] = 0.0
    for k in range(out.shape[0]):
        for j in range(count):
            code = np.int64(codes[group, j, k // 4, lane, k % 4]) - 128
            low = np.int64(rest[item, k, j, 0]) | (np.int64(rest[item, k, j, 1]) << 8)
            left = low | (np.int64(rest[item, k, j, 2]) << 16)
            if abs(code) <= LINEAR:
                left -= (left & _MANTISSA) << 1
                out[k, j] = code * scale + left * unit
            else:
                below = 2 * (abs(code) - LINEAR - 1) + (left >> 23)
                x = math.ldexp(1.0 + (left & (_MANTISSA - 1)) / _MANTISSA, int(exponent - 2 - below))
                out[k, j] = x if code > 0 else -x
