"""Products of a few rows, zero in many places, with a tall matrix: what is multiplied by zero is not read."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["sparse_products", "sparse_products_in_halves"]

Float32Array = npt.NDArray[np.float32]


@njit(cache=True, nogil=True)
def sparse_products(rows: Float32Array, matrix: Float32Array) -> Float32Array:
    """Product (n, r) of rows (n, d) and a matrix (d, r), four rows of the matrix a pass."""
    used = _used_columns(rows)
    products = np.zeros((len(rows), matrix.shape[1]), dtype=np.float32)
    whole = len(used) - len(used) % 4
    for start in range(0, whole, 4):
        four = used[start : start + 4]
        _add_four(rows, four, matrix[four[0]], matrix[four[1]], matrix[four[2]], matrix[four[3]], products)
    for start in range(whole, len(used)):
        _add_one(rows, used[start], matrix[used[start]], products)
    return products


@njit(cache=True, nogil=True)
def sparse_products_in_halves(rows: Float32Array, halves: npt.NDArray[np.uint16]) -> Float32Array:
    """The same with the matrix of float32 numbers whose upper 16 bits are given, the lower being zero."""
    used = _used_columns(rows)
    products = np.zeros((len(rows), halves.shape[1]), dtype=np.float32)
    bits = np.empty((4, halves.shape[1]), dtype=np.uint32)
    values = bits.view(np.float32)
    whole = len(used) - len(used) % 4
    for start in range(0, whole, 4):
        four = used[start : start + 4]
        for k in range(4):
            _widen(halves[four[k]], bits[k])
        _add_four(rows, four, values[0], values[1], values[2], values[3], products)
    for start in range(whole, len(used)):
        _widen(halves[used[start]], bits[0])
        _add_one(rows, used[start], values[0], products)
    return products


@njit(cache=True, nogil=True)
def _used_columns(rows: Float32Array) -> npt.NDArray[np.int64]:
    """Columns in which any row is not zero."""
    used = np.empty(rows.shape[1], dtype=np.int64)
    count = 0
    for i in range(rows.shape[1]):
        for k in range(len(rows)):
            if rows[k, i] != 0.0:
                used[count] = i
                count += 1
                break
    return used[:count]


@njit(cache=True, nogil=True, inline="always")
def _widen(halves: npt.NDArray[np.uint16], bits: npt.NDArray[np.uint32]) -> None:
    for j in range(len(bits)):
        bits[j] = np.uint32(halves[j]) << np.uint32(16)


@njit(cache=True, nogil=True, inline="always")
def _add_four(
    rows: Float32Array,
    columns: npt.NDArray[np.int64],
    m0: Float32Array,
    m1: Float32Array,
    m2: Float32Array,
    m3: Float32Array,
    products: Float32Array,
) -> None:
    for k in range(len(rows)):
        w0, w1, w2, w3 = (
            rows[k, columns[0]],
            rows[k, columns[1]],
            rows[k, columns[2]],
            rows[k, columns[3]],
        )
        into = products[k]
        for j in range(len(into)):
            into[j] += (w0 * m0[j] + w1 * m1[j]) + (w2 * m2[j] + w3 * m3[j])


@njit(cache=True, nogil=True, inline="always")
def _add_one(rows: Float32Array, column: int, values: Float32Array, products: Float32Array) -> None:
    for k in range(len(rows)):
        weight, into = rows[k, column], products[k]
        for j in range(len(into)):
            into[j] += weight * values[j]
