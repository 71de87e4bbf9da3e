"""Smooth functions read from tables: the cubic through the four nodes around a place."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["read_products", "read_rows"]

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]


@njit(cache=True, nogil=True)
def _cubic(place: float, nodes: int) -> tuple[np.uint64, np.float32, np.float32, np.float32, np.float32]:
    """First of the four nodes around a place, and their weights in single precision.

    Nodes are unsigned, which spares the test for an index from the end: that would keep loops from vectorising.
    """
    k = min(int(place), nodes - 3)
    t = place - k
    return (
        np.uint64(k - 1),
        np.float32(-t * (t - 1.0) * (t - 2.0) / 6.0),
        np.float32((t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0),
        np.float32(-(t + 1.0) * t * (t - 2.0) / 2.0),
        np.float32((t + 1.0) * t * (t - 1.0) / 6.0),
    )


@njit(cache=True, nogil=True)
def read_rows(places: FloatArray, table: Float32Array, rows: Float32Array) -> None:
    """Write rows (n, p) of a table (nodes, p) at places (n,) in [1, nodes - 2], in units of the nodes."""
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    for n in range(len(places)):
        k, w0, w1, w2, w3 = _cubic(places[n], table.shape[0])
        for i in range(np.uint64(table.shape[1])):
            rows[n, i] = (w0 * table[k, i] + w1 * table[k + one, i]) + (
                w2 * table[k + two, i] + w3 * table[k + three, i]
            )


@njit(cache=True, nogil=True)
def read_products(
    first_places: FloatArray, first: Float32Array, second_places: FloatArray, second: Float32Array
) -> Float32Array:
    """Products (n, p), value by value, of rows read from two tables (nodes, p) at places as ``read_rows`` has them."""
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    products = np.empty((len(first_places), first.shape[1]), dtype=np.float32)
    for n in range(len(first_places)):
        a, w0, w1, w2, w3 = _cubic(first_places[n], first.shape[0])
        b, v0, v1, v2, v3 = _cubic(second_places[n], second.shape[0])
        for i in range(np.uint64(first.shape[1])):
            products[n, i] = (
                (w0 * first[a, i] + w1 * first[a + one, i])
                + (w2 * first[a + two, i] + w3 * first[a + three, i])
            ) * (
                (v0 * second[b, i] + v1 * second[b + one, i])
                + (v2 * second[b + two, i] + v3 * second[b + three, i])
            )
    return products
