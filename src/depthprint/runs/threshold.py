"""A threshold for a finished drive whose truth is unknown, from how well neighbouring answers agree."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = ["agreement", "agreement_threshold"]


def agreement(matches: npt.ArrayLike, window: int = 5) -> npt.NDArray[np.bool_]:
    """Whether each query's match lies within ``window`` frames of the match of the query before or after it.

    matches: (q,) place numbers of consecutive queries. A true return is driven for several frames, forwards or
    backwards, so its matches run along; a chance resemblance seldom does. Returns (q,) bool.
    """
    places = np.asarray(matches, dtype=np.int64)
    if places.ndim != 1:
        raise DataError(f"agreement: expected matches (q,), got shape {places.shape}")
    near = np.abs(np.diff(places)) <= window
    agrees = np.zeros(len(places), dtype=bool)
    agrees[1:] |= near
    agrees[:-1] |= near
    return agrees


def agreement_threshold(
    matches: npt.ArrayLike, distances: npt.ArrayLike, *, window: int = 5, share: float = 0.95
) -> float | None:
    """Largest distance up to which at least ``share`` of the matches agree with a neighbour's; None if there is none.

    matches, distances: (q,) best place and its distance of consecutive queries. A rule of thumb for drives without
    ground truth, not a guarantee: places that resemble each other for long stretches agree as well.
    Raises DataError for arrays of different lengths or distances that are not finite, SettingsError for a share
    outside (0, 1].
    """
    values = np.asarray(distances, dtype=np.float64)
    agrees = agreement(matches, window)
    if values.shape != agrees.shape or not np.isfinite(values).all():
        raise DataError(
            f"agreement_threshold: expected one finite distance per match, got {values.shape} for {agrees.shape}"
        )
    if not 0 < share <= 1:
        raise SettingsError(f"agreement_threshold: expected a share in (0, 1], got {share}")
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    agreeing_share = np.cumsum(agrees[order]) / np.arange(1, len(order) + 1)
    last_of_tie = np.append(ordered[1:] != ordered[:-1], True) if len(ordered) else np.empty(0, dtype=bool)
    passing = np.flatnonzero(last_of_tie & (agreeing_share >= share))
    return float(ordered[passing[-1]]) if len(passing) else None
