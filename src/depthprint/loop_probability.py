"""Probability that a proposed place is the query's, learned from a drive whose truth nobody knows."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = ["match_probabilities", "same_place_odds"]

_STEPS = 50
_RIDGE = 1e-5
_LARGEST_LOG_ODDS = 30.0


def same_place_odds(
    distances: npt.ArrayLike, same: npt.ArrayLike, different: npt.ArrayLike
) -> npt.NDArray[np.float64]:
    """Likelihood ratio of 'same place' to 'different place' for distances (m,).

    same: (a,) distances of frames next to each other in time, which see one place. different: (b,) of frames far
    apart. Both kinds weigh alike in a logistic regression of the distance with a light ridge, so that the ratio
    never grows with the distance. Raises DataError for fewer than two of either, or ones that are not finite.
    """
    sides = [np.asarray(values, dtype=np.float64) for values in (same, different)]
    for name, values in zip(("same", "different"), sides, strict=True):
        if values.ndim != 1 or len(values) < 2 or not np.isfinite(values).all():
            raise DataError(f"same_place_odds: expected at least two finite distances for {name!r}")
    asked = np.asarray(distances, dtype=np.float64)
    if not np.isfinite(asked).all():
        raise DataError("same_place_odds: expected finite distances")
    everything = np.concatenate(sides)
    centre, scale = float(everything.mean()), float(everything.std()) or 1.0
    labels = np.concatenate([np.ones(len(sides[0])), np.zeros(len(sides[1]))])
    weights = np.where(labels == 1, 0.5 / len(sides[0]), 0.5 / len(sides[1]))
    intercept, slope = _logistic((everything - centre) / scale, labels, weights)
    log_odds = intercept + min(slope, 0.0) * (asked - centre) / scale
    return np.asarray(np.exp(np.clip(log_odds, -_LARGEST_LOG_ODDS, _LARGEST_LOG_ODDS)))


def match_probabilities(
    odds: Sequence[float] | npt.NDArray[np.float64], candidates: int, return_rate: float = 0.3
) -> npt.NDArray[np.float64]:
    """Probabilities (m + 1,) that each proposed place is the query's, and last, that it is a new place.

    odds: (m,) likelihood ratios of the proposed places; the others among ``candidates`` are taken to speak against
    themselves. return_rate: share of frames that come back to a place, spread evenly over the candidates beforehand.
    Raises SettingsError for a rate outside (0, 1), DataError for fewer candidates than odds.
    """
    if not 0 < return_rate < 1:
        raise SettingsError(f"match_probabilities: expected a return rate in (0, 1), got {return_rate}")
    ratios = np.asarray(odds, dtype=np.float64)
    if candidates < max(1, len(ratios)):
        raise DataError(f"match_probabilities: expected at least {len(ratios)} candidates, got {candidates}")
    mass = np.append(return_rate / candidates * ratios, 1.0 - return_rate)
    return np.asarray(mass / mass.sum())


def _logistic(
    x: npt.NDArray[np.float64], labels: npt.NDArray[np.float64], weights: npt.NDArray[np.float64]
) -> tuple[float, float]:
    """Intercept and slope by damped Newton steps."""
    design = np.stack([np.ones_like(x), x])
    beta = np.zeros(2)

    def loss(b: npt.NDArray[np.float64]) -> float:
        z = b @ design
        return float(weights @ (np.logaddexp(0.0, z) - labels * z) + 0.5 * _RIDGE * (b @ b))

    current = loss(beta)
    for _ in range(_STEPS):
        p = 1.0 / (1.0 + np.exp(-np.clip(beta @ design, -500, 500)))
        gradient = design @ (weights * (p - labels)) + _RIDGE * beta
        hessian = (design * (weights * p * (1 - p))) @ design.T + _RIDGE * np.eye(2)
        step = np.linalg.solve(hessian, gradient)
        size = 1.0
        while size > 1e-6 and loss(beta - size * step) > current:
            size /= 2
        beta = beta - size * step
        previous, current = current, loss(beta)
        if math.isclose(previous, current, rel_tol=1e-12, abs_tol=1e-15):
            break
    return float(beta[0]), float(beta[1])
