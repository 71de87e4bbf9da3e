"""A threshold for a finished drive whose truth is unknown, from how distances of different places spread."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = ["background_threshold"]

_BELOW_ONE_SIGMA = 0.15865525393145707


def background_threshold(
    distances: npt.ArrayLike, candidates: float, *, false_per_query: float = 0.1
) -> float | None:
    """Distance that a query without a true match is expected to undercut with about this chance.

    distances: (n,) of pairs far apart in time, most of them different places; the few returns among them hardly move
    the two quantiles used. candidates: how many places a query is compared with on average. The lower half of the
    distances is taken for that of a normal distribution (median, and the quantile one sigma below), whose tail gives
    the distance that ``false_per_query / candidates`` of all pairs fall under: a rule of thumb, not a guarantee.
    None where the distances do not spread, so that no threshold can be told. Raises DataError for too few distances or
    ones that are not finite, SettingsError for arguments out of range.
    """
    values = np.asarray(distances, dtype=np.float64)
    if values.ndim != 1 or len(values) < 2 or not np.isfinite(values).all():
        raise DataError(
            f"background_threshold: expected at least two finite distances (n,), got shape {values.shape}"
        )
    if not 0 < false_per_query < 1 or not candidates > 0:
        raise SettingsError(
            "background_threshold: expected a chance in (0, 1) and candidates > 0, "
            f"got {false_per_query} and {candidates}"
        )
    from scipy.special import ndtri

    middle, below = np.quantile(values, (0.5, _BELOW_ONE_SIGMA))
    spread = middle - below
    if not spread > 0:
        return None
    return float(max(0.0, middle + ndtri(min(0.5, false_per_query / max(1.0, candidates))) * spread))
