"""Sums over the pixels of overlapping square patches: of kernels of their attributes, or by their patterns."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["patch_sums", "pattern_sums"]

Float32Array = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Int32Array = npt.NDArray[np.int32]


@njit(cache=True, nogil=True)
def patch_sums(
    numbers: Int32Array,
    kernels: Float32Array,
    magnitude: Float32Array,
    tops: IntArray,
    lefts: IntArray,
    axis: Float32Array,
) -> tuple[Float32Array, FloatArray]:
    """Magnitude times attribute kernel times position kernel, summed by patch: (patches, nodes^2, p).

    numbers: (h, w) rows of ``kernels`` (n, p), the pixels' attributes; most pixels are expected to have row 0, whose
    weights alone are added up. axis: (nodes, patch), the position kernel along either axis; the sum is first taken
    along the pixels' rows, for all patches that a row crosses. Second: squared norms (patches,) of the magnitudes.
    """
    nodes, patch = axis.shape
    p, n_lefts = kernels.shape[1], len(lefts)
    sums = np.zeros((len(tops) * n_lefts * nodes, nodes * p), dtype=np.float32)
    plain_sums = np.zeros((len(tops), n_lefts, nodes, nodes), dtype=np.float32)
    squares = np.zeros((len(tops), n_lefts))
    across = np.zeros((n_lefts, nodes * p), dtype=np.float32)
    plain = np.zeros((n_lefts, nodes), dtype=np.float32)
    row_squares = np.zeros(n_lefts)
    used = np.zeros(n_lefts, dtype=np.bool_)
    for r in range(numbers.shape[0]):
        for k in range(n_lefts):
            if used[k]:
                across[k] = 0.0
            used[k] = False
            plain[k] = 0.0
            row_squares[k] = 0.0
            for c in range(patch):
                weight = magnitude[r, lefts[k] + c]
                number = numbers[r, lefts[k] + c]
                row_squares[k] += np.float64(weight) * np.float64(weight)
                if number == 0:
                    for a in range(nodes):
                        plain[k, a] += weight * axis[a, c]
                    continue
                used[k] = True
                for a in range(nodes):
                    _add(
                        kernels,
                        np.uint64(number),
                        p,
                        weight * axis[a, c],
                        across,
                        np.uint64(k),
                        np.uint64(a * p),
                    )
        for t in range(len(tops)):
            if not tops[t] <= r < tops[t] + patch:
                continue
            for k in range(n_lefts):
                squares[t, k] += row_squares[k]
                for a in range(nodes):
                    share = axis[a, r - tops[t]]
                    for b in range(nodes):
                        plain_sums[t, k, a, b] += share * plain[k, b]
                    if used[k]:
                        into = np.uint64((t * n_lefts + k) * nodes + a)
                        _add(across, np.uint64(k), nodes * p, share, sums, into, np.uint64(0))
    whole = sums.reshape(len(tops) * n_lefts, nodes * nodes, p)
    flat = plain_sums.reshape(len(tops) * n_lefts, nodes * nodes)
    for t in range(len(whole)):
        for a in range(nodes * nodes):
            for i in range(p):
                whole[t, a, i] += flat[t, a] * kernels[0, i]
    return whole, squares.reshape(len(tops) * n_lefts)


@njit(cache=True, nogil=True)
def _add(
    rows: Float32Array, row: int, n: int, share: float, sums: Float32Array, into: int, first: int
) -> None:
    """Add a share of n values of a row to those of another from ``first`` on; unsigned, which spares tests."""
    for i in range(np.uint64(n)):
        sums[into, first + i] += share * rows[row, i]


@njit(cache=True, nogil=True)
def pattern_sums(
    numbers: Int32Array,
    magnitude: Float32Array,
    tops: IntArray,
    lefts: IntArray,
    positions: Float32Array,
    n_patterns: int,
) -> tuple[FloatArray, FloatArray]:
    """Magnitude times position kernel, summed by patch and pattern: (patches, q, n_patterns).

    numbers: (h, w) patterns. positions: (q, patch, patch). Second: squared norms (patches,) of the magnitudes.
    """
    q, patch, _ = positions.shape
    sums = np.zeros((len(tops) * len(lefts), q, n_patterns))
    squares = np.zeros(len(sums))
    number = -1
    for top in tops:
        for left in lefts:
            number += 1
            for r in range(patch):
                for c in range(patch):
                    weight = magnitude[top + r, left + c]
                    squares[number] += np.float64(weight) * np.float64(weight)
                    for k in range(q):
                        sums[number, k, numbers[top + r, left + c]] += weight * positions[k, r, c]
    return sums, squares
