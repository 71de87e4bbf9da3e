"""Parametric dictionaries: one mother function, moved, turned and stretched (paper section 2.1, Fig. 1)."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from depthprint.dictionary import Dictionary
from depthprint.errors import SettingsError

__all__ = ["MOTHERS", "parametric_dictionary"]

FloatArray = npt.NDArray[np.float64]
Mother = Callable[[FloatArray, FloatArray], FloatArray]

_TRIES_PER_ATOM = 50


def _gaussian(u: FloatArray, v: FloatArray) -> FloatArray:
    """A blob."""
    return np.asarray(np.exp(-(u * u + v * v)))


def _edge(u: FloatArray, v: FloatArray) -> FloatArray:
    """First derivative of the blob: a step of depth seen through a window."""
    return np.asarray(u * np.exp(-(u * u + v * v)))


def _anisotropic_refinement(u: FloatArray, v: FloatArray) -> FloatArray:
    """Second derivative of the blob across, the blob along: a ridge or contour."""
    return np.asarray((4 * u * u - 2) * np.exp(-(u * u + v * v)))


def _gabor(u: FloatArray, v: FloatArray) -> FloatArray:
    """A wave under the blob."""
    return np.asarray(np.cos(np.pi * u) * np.exp(-(u * u + v * v) / 2))


MOTHERS = MappingProxyType(
    {
        "gaussian": _gaussian,
        "edge": _edge,
        "anisotropic_refinement": _anisotropic_refinement,
        "gabor": _gabor,
    }
)


def parametric_dictionary(
    shape: tuple[int, int],
    n_atoms: int = 256,
    *,
    mother: str = "gaussian",
    seed: int = 0,
    largest_correlation: float = 0.97,
) -> Dictionary:
    """Sample a mother function under translation, rotation and non-uniform scaling as unit atoms.

    shape: (height, width) in pixels; atoms are images of it in row order, d = height * width. The first atom
        is constant, for the mean. The others have their centre anywhere in the image, any angle, and two
        scales from 0.6 px to half the longer side, spread evenly in their logarithm.
    mother: ``gaussian``, ``edge``, ``anisotropic_refinement`` or ``gabor``.
    seed: offset of the low-discrepancy sequence that runs through the five parameters.
    largest_correlation: no two atoms have an inner product beyond this in size.

    Raises SettingsError for an unknown mother, an impossible size, or when the image is too small for that
    many different atoms.

    Source: paper section 2.1 and Fig. 1; Figueras i Ventura, Vandergheynst and Frossard 2006 for the
        anisotropic
    refinement atoms; the sequence is the additive recurrence of Roberts 2018.
    """
    height, width = shape
    if height < 1 or width < 1 or n_atoms < 1:
        raise SettingsError(f"expected a shape and n_atoms of at least 1, got {shape} and {n_atoms}")
    if mother not in MOTHERS:
        raise SettingsError(f"mother: expected one of {', '.join(MOTHERS)}, got {mother!r}")
    if not 0 < largest_correlation < 1:
        raise SettingsError(
            f"largest_correlation: expected a number between 0 and 1, got {largest_correlation!r}"
        )

    atoms = np.empty((n_atoms, height * width))
    atoms[0] = 1 / np.sqrt(height * width)
    found = 1
    offset = np.random.default_rng(seed).random(5)
    steps = _recurrence_steps(5)
    for i in range(_TRIES_PER_ATOM * n_atoms):
        if found == n_atoms:
            break
        atom = _sample(MOTHERS[mother], shape, (offset + (i + 1) * steps) % 1)
        if atom is not None and np.abs(atoms[:found] @ atom).max() <= largest_correlation:
            atoms[found] = atom
            found += 1
    if found < n_atoms:
        raise SettingsError(
            f"n_atoms: found only {found} different {mother} atoms on {height} x {width} pixels, "
            f"expected {n_atoms}"
        )
    settings = {"shape": [height, width], "mother": mother, "largest_correlation": largest_correlation}
    return Dictionary(atoms, "parametric", settings, seed)


def _recurrence_steps(dimensions: int) -> FloatArray:
    """Powers of 1 / phi, phi the positive root of phi^(n + 1) = phi + 1: badly approximable together."""
    phi = 2.0
    for _ in range(64):
        phi = (1 + phi) ** (1 / (dimensions + 1))
    return np.asarray(phi ** -np.arange(1.0, dimensions + 1))


def _sample(mother: Mother, shape: tuple[int, int], place: FloatArray) -> FloatArray | None:
    """One unit atom for a point of the unit cube (row, column, angle, scales); None if nothing is left."""
    height, width = shape
    y, x = np.mgrid[0:height, 0:width]
    dy = y - (place[0] * height - 0.5)
    dx = x - (place[1] * width - 0.5)
    angle = np.pi * place[2]
    smallest, largest = 0.6, max(0.6, max(shape) / 2)
    across, along = smallest * (largest / smallest) ** place[3:]
    u = (np.cos(angle) * dx + np.sin(angle) * dy) / across
    v = (np.cos(angle) * dy - np.sin(angle) * dx) / along
    atom = mother(u, v).ravel()
    norm = float(np.sqrt(atom @ atom))
    return atom / norm if norm > 1e-3 else None
