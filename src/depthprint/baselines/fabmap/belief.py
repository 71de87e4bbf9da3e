"""FAB-MAP online: a map of places, the belief about where the camera is, and the new place among the answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.baselines.fabmap.inverted_index import LikelihoodIndex
from depthprint.baselines.fabmap.model import FabMapModel
from depthprint.baselines.fabmap.observation import log_seen_at_new_place, word_states
from depthprint.baselines.fabmap.posterior import log_posterior, motion_prior, smoothed

__all__ = ["Belief", "FabMap"]

FloatArray = npt.NDArray[np.float64]
Words = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Belief:
    """Where an image was taken: log probability of a new place, and (n,) of each old one; together they sum to one."""

    log_new: float
    log_places: FloatArray


class FabMap:
    """Places by their words; ``locate`` tells where an image is, ``follow`` makes that the belief of the next prior."""

    def __init__(self, model: FabMapModel) -> None:
        self._model = model
        self._places = LikelihoodIndex(model.tree, model.settings)
        self._sampled = LikelihoodIndex(model.tree, model.settings)
        for words in model.training:
            self._sampled.add(words)
        self._mean_field = log_seen_at_new_place(model.tree, model.settings)
        self._earlier: FloatArray | None = None

    def add(self, words: Words) -> int:
        """Store the place of an image by its words, and return its number."""
        return self._places.add(words)

    def locate(self, words: Words, limit: int | None = None) -> Belief:
        """Belief over the places below ``limit`` (all when None) and a new one; changes nothing."""
        old = self._places.log_likelihoods(words, limit)
        likelihoods = np.concatenate([[self.new_place_log_likelihood(words)], old])
        log_p = log_posterior(likelihoods, motion_prior(self._earlier, len(old), self._model.settings))
        return Belief(float(log_p[0]), log_p[1:])

    def follow(self, belief: Belief) -> None:
        """Take a belief as the earlier one of the next image."""
        log_p = np.concatenate([[belief.log_new], belief.log_places])
        self._earlier = smoothed(log_p, self._model.settings)

    def new_place_log_likelihood(self, words: Words) -> float:
        """Log P(Z) at a place never visited: the mean over training images, or the mean field."""
        if self._model.settings.new_place == "sampled":
            samples = self._sampled.log_likelihoods(words)
            return float(np.logaddexp.reduce(samples) - np.log(len(samples)))
        seen, parent_seen = word_states(words, self._model.tree)
        return float(self._mean_field[np.arange(len(seen)), seen, parent_seen].sum())
