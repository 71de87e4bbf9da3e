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

__all__ = ["mp_block", "omp_block", "squared_norms"]

Array = Any


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
def _residual_norm(
    signal: Array, atoms: Array, picked: Array, coefficients: Array, n: int, work: Array
) -> float:
    work[:] = signal
    for k in range(n):
        c = coefficients[k]
        atom = atoms[picked[k]]
        for i in range(work.size):
            work[i] -= c * atom[i]
    return float(np.sqrt(_squared_norm(work)))


@njit(cache=True, nogil=True)
def omp_block(
    signals: Array,
    correlations: Array,
    gram: Array,
    atoms: Array,
    squared: Array,
    tolerance: float,
    zero: float,
    dependent: float,
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
    """
    m, n_atoms = correlations.shape
    limit = picked.shape[1]
    basis = np.empty((limit, n_atoms), dtype=correlations.dtype)
    distance = np.empty(n_atoms, dtype=correlations.dtype)
    taken = np.zeros(n_atoms, dtype=np.bool_)
    triangle = np.empty((limit, limit))
    along = np.empty(limit)
    work = np.empty(signals.shape[1], dtype=signals.dtype)
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
                c = basis[k, best]
                other = basis[k]
                for i in range(n_atoms):
                    row[i] -= c * other[i]
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
        residual_norms[s] = _residual_norm(signals[s], atoms, picked[s], coefficients[s], n, work)


@njit(cache=True, nogil=True)
def mp_block(
    signals: Array,
    correlations: Array,
    gram: Array,
    atoms: Array,
    squared: Array,
    tolerance: float,
    zero: float,
    score: Array,
    score_bits: Array,
    picked: Array,
    coefficients: Array,
    counts: Array,
    residual_norms: Array,
) -> None:
    """Matching pursuit of each row in at most ``picked.shape[1]`` steps; a repeated pick adds up."""
    m, n_atoms = correlations.shape
    limit = picked.shape[1]
    slot = np.full(n_atoms, -1, dtype=np.int32)
    work = np.empty(signals.shape[1], dtype=signals.dtype)
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
        residual_norms[s] = _residual_norm(signals[s], atoms, picked[s], coefficients[s], n, work)
