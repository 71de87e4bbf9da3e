"""Products of a few rows, zero in many places, with a tall matrix: what is multiplied by zero is not read."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["sparse_products"]

Float32Array = npt.NDArray[np.float32]


@njit(cache=True, nogil=True)
def sparse_products(rows: Float32Array, matrix: Float32Array) -> Float32Array:
    """Product (n, r) of rows (n, d) and a matrix (d, r), four rows of the matrix a pass."""
    n, d = rows.shape
    width = matrix.shape[1]
    used = np.empty(d + 3, dtype=np.int64)
    count = 0
    for i in range(d):
        for k in range(n):
            if rows[k, i] != 0.0:
                used[count] = i
                count += 1
                break
    products = np.zeros((n, width), dtype=np.float32)
    whole = count - count % 4
    for start in range(0, whole, 4):
        i0, i1, i2, i3 = used[start], used[start + 1], used[start + 2], used[start + 3]
        m0, m1, m2, m3 = matrix[i0], matrix[i1], matrix[i2], matrix[i3]
        for k in range(n):
            w0, w1, w2, w3 = rows[k, i0], rows[k, i1], rows[k, i2], rows[k, i3]
            into = products[k]
            for j in range(width):
                into[j] += (w0 * m0[j] + w1 * m1[j]) + (w2 * m2[j] + w3 * m3[j])
    for start in range(whole, count):
        values = matrix[used[start]]
        for k in range(n):
            weight, into = rows[k, used[start]], products[k]
            for j in range(width):
                into[j] += weight * values[j]
    return products
