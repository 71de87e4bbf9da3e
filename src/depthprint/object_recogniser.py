"""The fused recogniser of objects: discriminants over two kernels, and the nearest stored views."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.classification import NearestComplexityClassifier, class_distances
from depthprint.discriminant import KernelDiscriminant
from depthprint.errors import DataError, ModelError

__all__ = ["FusedRecogniser", "ViewComparison"]

FloatArray = npt.NDArray[np.float64]

# Chosen on cad51's first view of each turn; see docs/results.md. Halves and doubles of both do nearly as well.
SHRINKAGE = 0.5
NEAREST_SHARE = 0.5
LOCAL_SCALING = 10


@dataclass(frozen=True)
class ViewComparison:
    """How views (m) compare with the stored views (n).

    kernel: (m, n) of the discriminant. distances: (m, n) matrices of the nearest-neighbour terms, one each.
    """

    kernel: npt.NDArray[np.floating[Any]]
    distances: tuple[npt.NDArray[np.floating[Any]], ...] = field(default=())


class FusedRecogniser:
    """Sum of standardised scores: a kernel discriminant, and half of it the nearest stored view of each class.

    The discriminant knows what varies within classes; the nearest neighbour, with local scaling, knows classes that
    fall into several kinds. Either alone is weaker in category or in instance. Scores of several views of one object
    add up.
    """

    def __init__(
        self,
        *,
        shrinkage: float = SHRINKAGE,
        nearest_share: float = NEAREST_SHARE,
        local_scaling: int = LOCAL_SCALING,
    ) -> None:
        self.nearest_share = nearest_share
        self._discriminant = KernelDiscriminant(shrinkage)
        self._local_scaling = local_scaling
        self._nearest: list[NearestComplexityClassifier] = []

    @property
    def labels(self) -> npt.NDArray[Any]:
        """Labels (c,) of the columns of scores, sorted."""
        if not len(self._discriminant.labels):
            raise ModelError("FusedRecogniser: not fitted")
        return self._discriminant.labels

    def fit(self, stored: ViewComparison, labels: npt.ArrayLike) -> FusedRecogniser:
        """Learn from how the stored views compare among themselves, all (n, n), and their labels (n,)."""
        self._discriminant.fit(stored.kernel, labels)
        m = min(self._local_scaling, len(self._discriminant.weights) - 1)
        self._nearest = [
            NearestComplexityClassifier(local_scaling=m).fit(distances, labels)
            for distances in stored.distances
        ]
        return self

    def scores(self, queries: ViewComparison) -> FloatArray:
        """Scores (m, c), larger is better, from how queries compare with the stored views, all (m, n)."""
        if len(queries.distances) != len(self._nearest):
            raise DataError(
                f"FusedRecogniser: expected {len(self._nearest)} matrices of distances, "
                f"got {len(queries.distances)}"
            )
        total = standardised(self._discriminant.scores(queries.kernel))
        for classifier, distances in zip(self._nearest, queries.distances, strict=True):
            nearest = -class_distances(classifier, distances)
            total += self.nearest_share / len(self._nearest) * standardised(nearest)
        return total


def standardised(scores: FloatArray) -> FloatArray:
    """Each row with mean 0 and deviation 1, so that scores of different kinds can be added."""
    centred = scores - scores.mean(axis=1, keepdims=True)
    return np.asarray(centred / np.maximum(centred.std(axis=1, keepdims=True), 1e-12))
