"""Exact lasso on the Gram matrix, and the sequential part of an online dictionary update."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["lasso_block", "update_atoms_block"]

Array = Any

_SWEEPS_PER_JUMP = 6


@njit(cache=True, nogil=True)
def _violation(gradient: Array, code: Array, penalty: float) -> float:
    """Largest distance of minus the smooth gradient from ``penalty`` times the subdifferential of |.|_1."""
    worst = 0.0
    for i in range(code.size):
        if code[i] > 0.0:
            distance = abs(gradient[i] - penalty)
        elif code[i] < 0.0:
            distance = abs(gradient[i] + penalty)
        else:
            distance = abs(gradient[i]) - penalty
        worst = max(worst, distance)
    return worst


@njit(cache=True, nogil=True)
def _move(gradient: Array, row: Array, delta: float) -> None:
    for i in range(gradient.size):
        gradient[i] -= delta * row[i]


@njit(cache=True, nogil=True)
def _sweep(gradient: Array, gram: Array, code: Array, penalty: float) -> None:
    """One pass of coordinate descent over the atoms that are in use or want to be."""
    for j in range(code.size):
        old = code[j]
        if old == 0.0 and abs(gradient[j]) <= penalty:
            continue
        target = gradient[j] + old * gram[j, j]
        if target > penalty:
            new = (target - penalty) / gram[j, j]
        elif target < -penalty:
            new = (target + penalty) / gram[j, j]
        else:
            new = 0.0
        if new != old:
            code[j] = new
            _move(gradient, gram[j], new - old)


@njit(cache=True, nogil=True)
def _jump(gradient: Array, gram: Array, code: Array, penalty: float, support: Array, factor: Array, step: Array) -> None:
    """Solve on the support with its signs held, and go there or to the first change of sign on the way."""
    n = 0
    for j in range(code.size):
        if code[j] != 0.0:
            support[n] = j
            n += 1
    for a in range(n):
        for b in range(a + 1):
            value = gram[support[a], support[b]]
            for k in range(b):
                value -= factor[a, k] * factor[b, k]
            if a == b:
                if value <= 1e-10:
                    return
                factor[a, a] = np.sqrt(value)
            else:
                factor[a, b] = value / factor[b, b]
    for a in range(n):
        j = support[a]
        value = gradient[j] - penalty * np.sign(code[j])
        for k in range(a):
            value -= factor[a, k] * step[k]
        step[a] = value / factor[a, a]
    for a in range(n - 1, -1, -1):
        value = step[a]
        for k in range(a + 1, n):
            value -= factor[k, a] * step[k]
        step[a] = value / factor[a, a]
    length = 1.0
    crossing = -1
    for a in range(n):
        here = code[support[a]]
        if (here + step[a]) * here < 0.0 and -here / step[a] < length:
            length = -here / step[a]
            crossing = a
    for a in range(n):
        j = support[a]
        new = 0.0 if a == crossing else code[j] + length * step[a]
        _move(gradient, gram[j], new - code[j])
        code[j] = new


@njit(cache=True, nogil=True)
def lasso_block(
    correlations: Array, gram: Array, penalty: float, tolerance: float, max_rounds: int, codes: Array
) -> int:
    """Minimise 1/2 a'Ga - c'a + penalty |a|_1 for each row c; ``codes`` holds the start and takes the solution.

    Coordinate descent finds the support, a linear solve finishes it. A row is done when it meets the optimality
    conditions to ``tolerance * penalty``. Returns the number of rows that did not within ``max_rounds``.
    """
    m, n_atoms = correlations.shape
    gradient = np.empty(n_atoms)
    support = np.empty(n_atoms, dtype=np.int64)
    factor = np.empty((n_atoms, n_atoms))
    step = np.empty(n_atoms)
    failed = 0
    for s in range(m):
        code = codes[s]
        gradient[:] = correlations[s]
        for j in range(n_atoms):
            if code[j] != 0.0:
                _move(gradient, gram[j], code[j])
        done = False
        for _ in range(max_rounds):
            for _ in range(_SWEEPS_PER_JUMP):
                _sweep(gradient, gram, code, penalty)
                done = _violation(gradient, code, penalty) <= tolerance * penalty
                if done:
                    break
            if done:
                break
            _jump(gradient, gram, code, penalty, support, factor, step)
            done = _violation(gradient, code, penalty) <= tolerance * penalty
            if done:
                break
        if not done:
            failed += 1
    return failed


@njit(cache=True, nogil=True)
def update_atoms_block(atoms: Array, pull: Array, usage: Array, first: int, used: float) -> None:
    """Update atoms ``first .. first + len(pull)`` in turn, each to unit norm, given those before it.

    ``pull`` holds these rows of B - A D for the dictionary as it comes in; it is kept up to date within the block.
    Atoms whose usage A_jj is not above ``used`` stay.
    """
    n, d = pull.shape
    new = np.empty(d)
    for k in range(n):
        j = first + k
        if not usage[j, j] > used:
            continue
        norm = 0.0
        for i in range(d):
            new[i] = pull[k, i] / usage[j, j] + atoms[j, i]
            norm += new[i] * new[i]
        norm = np.sqrt(norm)
        if not norm > 1e-12:
            continue
        for i in range(d):
            value = new[i] / norm
            new[i] = value - atoms[j, i]
            atoms[j, i] = value
        for later in range(k + 1, n):
            weight = usage[first + later, j]
            if weight != 0.0:
                for i in range(d):
                    pull[later, i] -= weight * new[i]
