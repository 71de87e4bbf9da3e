"""Smooth functions read from tables: the cubic through the four nodes around a place."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["pair_products", "read_rows"]


@njit(cache=True, nogil=True)
def read_rows(places: npt.NDArray[np.float64], table: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
    """Rows (n, p) of a table (nodes, p) at places (n,) in [1, nodes - 2], in units of the nodes."""
    rows = np.empty((len(places), table.shape[1]), dtype=np.float32)
    last = table.shape[0] - 3
    for n in range(len(places)):
        k = min(int(places[n]), last)
        t = places[n] - k
        w0 = np.float32(-t * (t - 1.0) * (t - 2.0) / 6.0)
        w1 = np.float32((t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0)
        w2 = np.float32(-(t + 1.0) * t * (t - 2.0) / 2.0)
        w3 = np.float32((t + 1.0) * t * (t - 1.0) / 6.0)
        row, a, b, c, d = rows[n], table[k - 1], table[k], table[k + 1], table[k + 2]
        for i in range(table.shape[1]):
            row[i] = (w0 * a[i] + w1 * b[i]) + (w2 * c[i] + w3 * d[i])
    return rows


@njit(cache=True, nogil=True)
def pair_products(first: npt.NDArray[np.float32], second: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
    """Products (n, a b) of all pairs of values of two rows, (n, a) and (n, b), the second's fastest."""
    a, b = first.shape[1], second.shape[1]
    products = np.empty((len(first), a * b), dtype=np.float32)
    for n in range(len(first)):
        for i in range(a):
            for j in range(b):
                products[n, i * b + j] = first[n, i] * second[n, j]
    return products
