"""Exact lasso on the Gram matrix, and the sequential part of an online dictionary update."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["lasso_block", "update_atoms_block"]

Array = Any

_SWEEPS = 8
_DEPENDENT = 1e-10


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
def _support_of(code: Array, support: Array) -> int:
    n = 0
    for j in range(code.size):
        if code[j] != 0.0:
            support[n] = j
            n += 1
    return n


@njit(cache=True, nogil=True)
def _extend_factor(gram: Array, support: Array, factor: Array, done: int, n: int, column: Array) -> int:
    """Extend U with U'U = G on the support from column ``done`` on; n, or the place of a dependent atom."""
    for a in range(done, n):
        row = gram[support[a]]
        for b in range(a + 1):
            column[b] = row[support[b]]
        for b in range(a):
            value = column[b] / factor[b, b]
            factor[b, a] = value
            for k in range(b + 1, a):
                column[k] -= value * factor[b, k]
            column[a] -= value * value
        if not column[a] > _DEPENDENT:
            return a
        factor[a, a] = np.sqrt(column[a])
    return n


@njit(cache=True, nogil=True)
def _exchange(
    gradient: Array,
    gram: Array,
    code: Array,
    penalty: float,
    support: Array,
    factor: Array,
    place: int,
    step: Array,
) -> int:
    """Trade the atom at ``place`` against those before it, of which it is a combination, until one comes to zero.

    The fit stays as it is and the objective falls. Returns the place of the atom at zero, or -1 if none is met.
    """
    for a in range(place - 1, -1, -1):
        value = -factor[a, place]
        for k in range(a + 1, place):
            value -= factor[a, k] * step[k]
        step[a] = value / factor[a, a]
    step[place] = 1.0
    slope = 0.0
    for a in range(place + 1):
        j = support[a]
        slope += step[a] * (penalty * np.sign(code[j]) - gradient[j])
    direction = -1.0 if slope > 0.0 else 1.0
    length = np.inf
    crossing = -1
    for a in range(place + 1):
        rate = direction * step[a]
        here = code[support[a]]
        if rate * here < 0.0 and -here / rate < length:
            length = -here / rate
            crossing = a
    if crossing >= 0:
        for a in range(place + 1):
            j = support[a]
            new = 0.0 if a == crossing else code[j] + length * direction * step[a]
            _move(gradient, gram[j], new - code[j])
            code[j] = new
    return crossing


@njit(cache=True, nogil=True)
def _jump(
    gradient: Array,
    gram: Array,
    code: Array,
    penalty: float,
    support: Array,
    factor: Array,
    n: int,
    step: Array,
) -> int:
    """Solve on the support with its signs held, and go there, or to the first change of sign on the way.

    Returns the place in ``support`` of the atom that came to zero, or -1.
    """
    for a in range(n):
        j = support[a]
        step[a] = gradient[j] - penalty * np.sign(code[j])
    for a in range(n):
        step[a] /= factor[a, a]
        for k in range(a + 1, n):
            step[k] -= step[a] * factor[a, k]
    for a in range(n - 1, -1, -1):
        value = step[a]
        for k in range(a + 1, n):
            value -= factor[a, k] * step[k]
        step[a] = value / factor[a, a]
    length = 1.0
    crossing = -1
    for a in range(n):
        here = code[support[a]]
        if (here + step[a]) * here <= 0.0 and -here / step[a] <= length:
            length = -here / step[a]
            crossing = a
    for a in range(n):
        j = support[a]
        new = 0.0 if a == crossing else code[j] + length * step[a]
        _move(gradient, gram[j], new - code[j])
        code[j] = new
    return crossing


@njit(cache=True, nogil=True)
def _most_wanted(gradient: Array, code: Array) -> int:
    """The unused atom with the largest correlation with the residual, or -1."""
    best = -1
    top = 0.0
    for j in range(code.size):
        if code[j] == 0.0 and abs(gradient[j]) > top:
            top = abs(gradient[j])
            best = j
    return best


@njit(cache=True, nogil=True)
def lasso_block(
    correlations: Array, gram: Array, penalty: float, tolerance: float, max_rounds: int, codes: Array
) -> int:
    """Minimise 1/2 a'Ga - c'a + penalty |a|_1 for each row c, from ``codes`` and into it.

    Feature-sign search (Lee, Battle, Raina and Ng 2006): take in the atom that violates the optimality
    conditions most, solve on the support exactly, drop atoms that change sign. An atom that depends on others
    is traded for one of them; where that fails, sweeps of coordinate descent stand in. A row is done when it
    meets the conditions to ``tolerance * penalty``. Returns the number of rows not done in ``max_rounds``.
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
        n = _support_of(code, support)
        factored = 0
        done = False
        for _ in range(max_rounds):
            done = _violation(gradient, code, penalty) <= tolerance * penalty
            if done:
                break
            wanted = _most_wanted(gradient, code)
            if wanted >= 0 and abs(gradient[wanted]) > penalty:
                excess = abs(gradient[wanted]) - penalty
                code[wanted] = np.sign(gradient[wanted]) * excess / gram[wanted, wanted]
                _move(gradient, gram[wanted], code[wanted])
                support[n] = wanted
                n += 1
            independent = True
            while n > 0:
                factored = _extend_factor(gram, support, factor, factored, n, step)
                if factored < n:
                    crossing = _exchange(gradient, gram, code, penalty, support, factor, factored, step)
                    independent = crossing >= 0
                else:
                    crossing = _jump(gradient, gram, code, penalty, support, factor, n, step)
                if crossing < 0:
                    break
                for a in range(crossing, n - 1):
                    support[a] = support[a + 1]
                n -= 1
                factored = min(factored, crossing)
            if not independent:
                for _ in range(_SWEEPS):
                    _sweep(gradient, gram, code, penalty)
                n = _support_of(code, support)
                factored = 0
        if not done:
            failed += 1
    return failed


@njit(cache=True, nogil=True)
def update_atoms_block(atoms: Array, pull: Array, usage: Array, first: int, used: float) -> None:
    """Update atoms ``first .. first + len(pull)`` in turn, each to unit norm, given those before it.

    ``pull`` holds these rows of B - A D for the dictionary as it comes in; it is kept up to date within the
    block. Atoms whose usage A_jj is not above ``used`` stay.
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
