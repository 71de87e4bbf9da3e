"""A threshold from distances between different places, without ground truth."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = ["calibrate_threshold", "pairs_needed"]


def calibrate_threshold(distances: npt.ArrayLike, false_positive_rate: float) -> float:
    """Largest threshold that accepts at most a given share of distances between different places.

    distances: (n,) between places far apart in time, nearly all of them different; no ground truth.
        Returns among them can only lower the threshold, so the rate holds as an upper limit.
    false_positive_rate: share of *pairs* accepted, in (0, 1). A query compared with n independent places is
        wrong about n times as often. At least 1 / rate distances are needed, since fewer cannot show it.
    A pair is accepted when its distance <= threshold.
    Raises SettingsError for a rate outside (0, 1), DataError for too few or non-finite distances.
    """
    if not 0 < false_positive_rate < 1:
        raise SettingsError(f"calibrate_threshold: expected a rate in (0, 1), got {false_positive_rate}")
    values = np.asarray(distances, dtype=np.float64)
    if values.ndim != 1 or not np.isfinite(values).all():
        raise DataError(f"calibrate_threshold: expected finite distances (n,), got shape {values.shape}")
    needed = pairs_needed(false_positive_rate)
    if len(values) < needed:
        raise DataError(
            f"calibrate_threshold: a rate of {false_positive_rate:g} needs at least {needed} distances, "
            f"got {len(values)}"
        )
    allowed = math.floor(false_positive_rate * len(values) * (1 + 1e-12))
    first_refused = np.partition(values, allowed)[allowed]
    return float(np.nextafter(first_refused, -np.inf))


def pairs_needed(false_positive_rate: float) -> int:
    """Fewest distances that can show a rate: one in them must be allowed to be wrong."""
    return math.ceil(1 / false_positive_rate * (1 - 1e-12))
