"""From likelihoods to the probability of each place: motion prior, normalisation, smoothing."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.baselines.fabmap.settings import FabMapSettings

__all__ = ["log_odds_against", "log_posterior", "motion_prior", "smoothed", "with_neighbours"]

FloatArray = npt.NDArray[np.float64]


def motion_prior(earlier: FloatArray | None, n: int, settings: FabMapSettings) -> FloatArray:
    """Weights (n + 1,) of the new place, which comes first, and of the n old ones.

    An old place i weighs [2 (1 - m) p(i-1) + p(i) + 2 m p(i+1)] / 3 of the earlier belief (new place first; places
    it did not know get its mean), where m is ``motion_bias``. Without an earlier belief they weigh the same.
    """
    old = np.full(n, 1.0 / max(n, 1))
    if earlier is not None and settings.motion and len(earlier) > 1:
        known = earlier[1 : n + 1]
        old = np.full(n, float(known.mean()) if len(known) else 0.0)
        old[: len(known)] = known
        before = np.concatenate([old[:1], old[:-1]])
        after = np.concatenate([old[1:], old[-1:]])
        m = settings.motion_bias
        old = (2 * (1 - m) * before + old + 2 * m * after) / 3
    return np.concatenate([[settings.p_new], old])


def log_posterior(log_likelihoods: FloatArray, prior: FloatArray) -> FloatArray:
    """Log of likelihood times prior, normalised to a sum of one in probability."""
    with np.errstate(divide="ignore"):
        joint = log_likelihoods + np.log(prior)
    top = joint.max()
    return np.asarray(joint - top - np.log(np.exp(joint - top).sum()))


def smoothed(log_p: FloatArray, settings: FabMapSettings) -> FloatArray:
    """The probabilities, with the share that ``keep`` leaves spread evenly: the belief for the next frame."""
    return np.asarray(settings.keep * np.exp(log_p) + (1 - settings.keep) / len(log_p))


def with_neighbours(log_p: FloatArray, reach: int) -> FloatArray:
    """Log of each place's probability together with that of ``reach`` places before and after it."""
    if not reach or not len(log_p):
        return log_p
    padded = np.pad(log_p, reach, constant_values=-np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    return np.asarray(np.logaddexp.reduce(windows, axis=1))


def log_odds_against(log_new: float, log_places: FloatArray, neighbours: int = 0) -> FloatArray:
    """Log odds (n,) against each place and its neighbours: log (1 - p) - log p.

    Sure matches have a p that rounds to one; what is left outside is added up from its own logarithms instead.
    """
    log_p = with_neighbours(log_places, neighbours)
    against = np.log1p(-np.minimum(np.exp(log_p), 0.5)) - log_p
    for place in np.flatnonzero(log_p > np.log(0.5)):
        older = log_places[: max(0, place - neighbours)]
        newer = log_places[place + neighbours + 1 :]
        outside = np.logaddexp.reduce(np.concatenate([[log_new], older, newer]))
        against[place] = outside - log_p[place]
    return np.asarray(against)
