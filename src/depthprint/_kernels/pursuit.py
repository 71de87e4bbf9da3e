"""Greedy pursuits on the Gram matrix, one signal after another (paper eq. 3-7).

Each picked atom gives one orthonormal direction; ``basis[k]`` holds its inner products with all atoms, which
is the k-th row of a pivoted Cholesky factor of the Gram matrix. It yields the correlations of the next
residual, the coefficients by one triangular solve, and what each atom would still add (the OLS rule) without
touching pixels.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["mp_block", "omp_block", "residual_norms_block", "squared_norms"]

Array = Any

_STRIP = 1024


@njit(cache=True, nogil=True)
def _squared_norm(values: Array) -> float:
    """Sum of squares in double precision, in eight lanes of fixed order."""
    n = values.size
    whole = n - n % 8
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    for i in range(0, whole, 8):
        s0 += np.float64(values[i]) * np.float64(values[i])
        s1 += np.float64(values[i + 1]) * np.float64(values[i + 1])
        s2 += np.float64(values[i + 2]) * np.float64(values[i + 2])
        s3 += np.float64(values[i + 3]) * np.float64(values[i + 3])
        s4 += np.float64(values[i + 4]) * np.float64(values[i + 4])
        s5 += np.float64(values[i + 5]) * np.float64(values[i + 5])
        s6 += np.float64(values[i + 6]) * np.float64(values[i + 6])
        s7 += np.float64(values[i + 7]) * np.float64(values[i + 7])
    for i in range(whole, n):
        s0 += np.float64(values[i]) * np.float64(values[i])
    return ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))


@njit(cache=True, nogil=True)
def squared_norms(signals: Array, out: Array) -> None:
    """Squared norm of each row."""
    for i in range(signals.shape[0]):
        out[i] = _squared_norm(signals[i])


@njit(cache=True, nogil=True)
def _first_largest(bits: Array) -> int:
    """Index of the first largest non-negative float, by its bits as integers, which vectorise."""
    n = bits.size
    best_start = 0
    best = bits[0]
    for start in range(0, n, 64):
        top = bits[start]
        for i in range(start + 1, min(start + 64, n)):
            top = max(top, bits[i])
        if top > best:
            best = top
            best_start = start
    for i in range(best_start, n):
        if bits[i] == best:
            return i
    return 0


@njit(cache=True, nogil=True)
def _subtract(
    target: Array, matrix: Array, rows: Array, weights: Array, n: int, start: int, stop: int
) -> None:
    """Subtract n weighted rows of ``matrix`` in columns start to stop, one after the other, four a pass.

    Unsigned columns spare the test for an index from the end, which would keep the loop from vectorising.
    """
    whole = n - n % 4
    for k in range(0, whole, 4):
        w0, w1, w2, w3 = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
        r0, r1, r2, r3 = rows[k], rows[k + 1], rows[k + 2], rows[k + 3]
        for i in range(np.uint64(start), np.uint64(stop)):
            value = (target[i] - w0 * matrix[r0, i]) - w1 * matrix[r1, i]
            target[i] = (value - w2 * matrix[r2, i]) - w3 * matrix[r3, i]
    for k in range(whole, n):
        weight, row = weights[k], rows[k]
        for i in range(np.uint64(start), np.uint64(stop)):
            target[i] -= weight * matrix[row, i]


@njit(cache=True, nogil=True)
def residual_norms_block(
    signals: Array, atoms: Array, picked: Array, coefficients: Array, counts: Array, out: Array
) -> None:
    """Norm of signal less model where ``out`` is negative, by strips narrow enough to keep all atoms' in cache."""
    m, d = signals.shape
    work = np.empty(d, dtype=signals.dtype)
    squared = np.zeros(m)
    for start in range(0, d, _STRIP):
        stop = min(start + _STRIP, d)
        part = work[start:stop]
        for s in range(m):
            if out[s] < 0:
                part[:] = signals[s, start:stop]
                _subtract(work, atoms, picked[s], coefficients[s], counts[s], start, stop)
                squared[s] += _squared_norm(part)
    for s in range(m):
        if out[s] < 0:
            out[s] = np.sqrt(squared[s])


@njit(cache=True, nogil=True)
def omp_block(
    correlations: Array,
    gram: Array,
    squared: Array,
    tolerance: float,
    zero: float,
    dependent: float,
    trusted: float,
    by_gain: bool,
    score: Array,
    score_bits: Array,
    picked: Array,
    coefficients: Array,
    counts: Array,
    residual_norms: Array,
) -> None:
    """OMP (``by_gain`` false: largest |<R, g>|) or OLS (true: largest drop of the residual) of each row.

    ``correlations`` (m, K) is overwritten. ``score_bits`` is ``score`` seen as integers. A pursuit ends after
    ``picked.shape[1]`` atoms, at residual norm <= ``tolerance``, when no |<R, g>| exceeds ``zero`` times the
    signal's norm, or when the best atom has squared distance <= ``dependent`` to the span of those picked.
    A residual's norm whose square is at most ``trusted`` of the signal's is set to -1: the steps do not tell it
    well enough.
    """
    m, n_atoms = correlations.shape
    limit = picked.shape[1]
    basis = np.empty((limit, n_atoms), dtype=correlations.dtype)
    distance = np.empty(n_atoms, dtype=correlations.dtype)
    taken = np.zeros(n_atoms, dtype=np.bool_)
    triangle = np.empty((limit, limit))
    along = np.empty(limit)
    order = np.arange(limit)
    column = np.empty(limit, dtype=correlations.dtype)
    for s in range(m):
        alpha = correlations[s]
        left = squared[s]
        floor = zero * np.sqrt(squared[s])
        n = 0
        if by_gain:
            for i in range(n_atoms):
                distance[i] = gram[i, i]
        while n < limit and left > 0.0 and (tolerance < 0.0 or left > tolerance * tolerance):
            if by_gain:
                for i in range(n_atoms):
                    usable = (distance[i] > dependent) and not taken[i]
                    score[i] = alpha[i] * alpha[i] / distance[i] if usable else 0.0
            else:
                for i in range(n_atoms):
                    score[i] = abs(alpha[i])
                for k in range(n):
                    score[picked[s, k]] = 0.0
            best = _first_largest(score_bits)
            if taken[best] or not abs(alpha[best]) > floor:
                break
            height = np.float64(gram[best, best])
            for k in range(n):
                height -= np.float64(basis[k, best]) * np.float64(basis[k, best])
            if not height > dependent:
                break
            pivot = np.sqrt(height)
            step = np.float64(alpha[best]) / pivot
            if (
                step * step > left + zero * squared[s]
            ):  # more than there is: rounding on a near-dependent atom
                break
            for k in range(n):
                triangle[k, n] = basis[k, best]
            triangle[n, n] = pivot
            along[n] = step
            left -= step * step
            taken[best] = True
            picked[s, n] = best
            n += 1
            if n == limit:
                break
            row = basis[n - 1]
            row[:] = gram[best]
            for k in range(n - 1):
                column[k] = basis[k, best]
            _subtract(row, basis, order, column, n - 1, 0, n_atoms)
            scale = row.dtype.type(1.0 / pivot)
            move = row.dtype.type(step)
            for i in range(n_atoms):
                row[i] *= scale
                alpha[i] -= move * row[i]
            if by_gain:
                for i in range(n_atoms):
                    distance[i] -= row[i] * row[i]
        for k in range(n - 1, -1, -1):
            value = along[k]
            for j in range(k + 1, n):
                value -= triangle[k, j] * along[j]
            along[k] = value / triangle[k, k]
        for k in range(n):
            coefficients[s, k] = along[k]
            taken[picked[s, k]] = False
        counts[s] = n
        residual_norms[s] = np.sqrt(left) if n == 0 or left > trusted * squared[s] else -1.0


@njit(cache=True, nogil=True)
def mp_block(
    correlations: Array,
    gram: Array,
    squared: Array,
    tolerance: float,
    zero: float,
    score: Array,
    score_bits: Array,
    picked: Array,
    coefficients: Array,
    counts: Array,
) -> None:
    """Matching pursuit of each row in at most ``picked.shape[1]`` steps; a repeated pick adds up."""
    m, n_atoms = correlations.shape
    limit = picked.shape[1]
    slot = np.full(n_atoms, -1, dtype=np.int32)
    for s in range(m):
        alpha = correlations[s]
        left = squared[s]
        floor = zero * np.sqrt(squared[s])
        n = 0
        for _ in range(limit):
            if left <= 0.0 or (tolerance >= 0.0 and left <= tolerance * tolerance):
                break
            for i in range(n_atoms):
                score[i] = abs(alpha[i])
            best = _first_largest(score_bits)
            step = alpha[best]
            if not abs(step) > floor:
                break
            left -= np.float64(step) * np.float64(step)
            if slot[best] < 0:
                slot[best] = n
                picked[s, n] = best
                coefficients[s, n] = step
                n += 1
            else:
                coefficients[s, slot[best]] += step
            row = gram[best]
            for i in range(n_atoms):
                alpha[i] -= step * row[i]
        for k in range(n):
            slot[picked[s, k]] = -1
        counts[s] = n
