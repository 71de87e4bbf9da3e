"""Smooth functions read from tables: the cubic through the four nodes around a place."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["read_products", "read_rows"]

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]


@njit(cache=True, nogil=True)
def _read_row(place: float, table: Float32Array, row: Float32Array) -> None:
    k = min(int(place), table.shape[0] - 3)
    t = place - k
    w0 = np.float32(-t * (t - 1.0) * (t - 2.0) / 6.0)
    w1 = np.float32((t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0)
    w2 = np.float32(-(t + 1.0) * t * (t - 2.0) / 2.0)
    w3 = np.float32((t + 1.0) * t * (t - 1.0) / 6.0)
    a, b, c, d = table[k - 1], table[k], table[k + 1], table[k + 2]
    for i in range(len(row)):
        row[i] = (w0 * a[i] + w1 * b[i]) + (w2 * c[i] + w3 * d[i])


@njit(cache=True, nogil=True)
def read_rows(places: FloatArray, table: Float32Array, rows: Float32Array) -> None:
    """Write rows (n, p) of a table (nodes, p) at places (n,) in [1, nodes - 2], in units of the nodes."""
    for n in range(len(places)):
        _read_row(places[n], table, rows[n])


@njit(cache=True, nogil=True)
def read_products(
    first_places: FloatArray, first: Float32Array, second_places: FloatArray, second: Float32Array
) -> Float32Array:
    """Products (n, p), value by value, of rows read from two tables (nodes, p) at places as ``read_rows`` has them."""
    n, p = len(first_places), first.shape[1]
    products = np.empty((n, p), dtype=np.float32)
    other = np.empty(p, dtype=np.float32)
    for k in range(n):
        into = products[k]
        _read_row(first_places[k], first, into)
        _read_row(second_places[k], second, other)
        for i in range(p):
            into[i] *= other[i]
    return products
