"""The fused recogniser of objects: a discriminant, a support vector machine, and the nearest stored views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.classification import NearestComplexityClassifier
from depthprint.errors import DataError, ModelError
from depthprint.objects.discriminant import KernelDiscriminant

__all__ = [
    "KERNEL_SHARES",
    "FusedRecogniser",
    "JoinedScores",
    "ViewComparison",
    "fused_comparison",
    "nearest_weights",
]

FloatArray = npt.NDArray[np.float64]

# Chosen by nested splits of training objects; halves and doubles of each do nearly as well.
SHRINKAGE = 0.5
NEAREST_WEIGHT = 2.0
LOCAL_SCALING = 10
MACHINE_C = 40.0
# Shares of what views are compared by in the discriminant's kernel.
KERNEL_SHARES = {
    "codes": 2.0,
    "complexities": 1.0,
    "surfaces": 4.0,
    "sizeless": 4.0,
    "turned": 4.0,
    "pairs": 8.0,
}
# The same of the nearest views; those by information distance add nothing beside the others.
NEAREST_SHARES = {"codes": 1.0, "surfaces": 1.0, "sizeless": 1.0, "turned": 1.0, "pairs": 2.0}


@dataclass(frozen=True)
class ViewComparison:
    """How views (m) compare with the stored views (n).

    kernel: (m, k n) of the discriminant. distances: (m, k n) matrices of the nearest-neighbour terms, one each.
    machine_kernel: (m, k n) inner products for the support vector machine, None where there is no machine.
    k is 1, or more where further copies of the stored views (mirrored, partly hidden) are learned from: all first
    copies follow the views, then all second ones. Among the stored views all are (k n, k n).
    """

    kernel: npt.NDArray[np.floating[Any]]
    distances: tuple[npt.NDArray[np.floating[Any]], ...] = field(default=())
    machine_kernel: npt.NDArray[np.floating[Any]] | None = None


def fused_comparison(parts: Sequence[ViewComparison], shares: Sequence[float]) -> ViewComparison:
    """Weighted mean of the kernels, all matrices of distances, and the mean of what parts have for the machine."""
    # A copy of a view that one part knows is for the others the view itself.
    widest = max((p.kernel for p in parts), key=np.size)
    kernel = sum(
        share * _repeated(np.asarray(p.kernel, dtype=np.float64), widest.shape)
        for p, share in zip(parts, shares, strict=True)
    )
    for_machine = [p.machine_kernel for p in parts if p.machine_kernel is not None]
    machine = sum(for_machine[1:], for_machine[0]) / np.float32(len(for_machine)) if for_machine else None
    distances = tuple(matrix for p in parts for matrix in p.distances)
    return ViewComparison(np.asarray(kernel) / sum(shares), distances, machine)


def _repeated(kernel: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    if kernel.shape == shape:
        return kernel
    return np.tile(kernel, (shape[0] // len(kernel), shape[1] // kernel.shape[1]))


def nearest_weights(parts: Sequence[str]) -> tuple[float, ...]:
    """Weights, beside a discriminant of weight 1, of the nearest views by each part that has distances."""
    shares = [NEAREST_SHARES[part] for part in parts if part in NEAREST_SHARES]
    return tuple(NEAREST_WEIGHT * share / sum(shares) for share in shares)


@dataclass(frozen=True, eq=False)
class JoinedScores:
    """Sum of standardised scores of a discriminant, of a machine, and, weighted, of the nearest view of each class."""

    nearest: tuple[NearestComplexityClassifier, ...]
    weights: tuple[float, ...]

    @classmethod
    def of_distances(
        cls,
        distances: Sequence[npt.NDArray[np.floating[Any]]],
        labels: npt.NDArray[Any],
        local_scaling: int,
        weights: tuple[float, ...],
    ) -> JoinedScores:
        """Learn the scale of each stored view from distances (k n, k n) among them, labels (n,) of the first copies."""
        m = min(local_scaling, len(labels) - 1)
        nearest = (
            NearestComplexityClassifier(local_scaling=m).fit(one, _for_copies(labels, one))
            for one in distances
        )
        return cls(tuple(nearest), weights)

    @classmethod
    def of_scales(
        cls, scales: Sequence[FloatArray], labels: npt.NDArray[Any], weights: tuple[float, ...]
    ) -> JoinedScores:
        """The same from ``scales``, with the shipped local scaling."""
        m = min(LOCAL_SCALING, len(labels) - 1)
        nearest = (
            NearestComplexityClassifier(local_scaling=m).restore(one, _for_copies(labels, one))
            for one in scales
        )
        return cls(tuple(nearest), weights)

    @property
    def scales(self) -> tuple[FloatArray, ...]:
        """Scales (k n,) of the stored views, by distance."""
        return tuple(one.scales_ for one in self.nearest if one.scales_ is not None)

    def of(
        self,
        discriminant: FloatArray,
        machine: FloatArray | None,
        distances: Sequence[npt.NDArray[np.floating[Any]]],
    ) -> FloatArray:
        """Scores (m, c) from those of the discriminant and of the machine, and from distances to the stored views."""
        if len(distances) != len(self.nearest):
            raise DataError(
                f"FusedRecogniser: expected {len(self.nearest)} matrices of distances, got {len(distances)}"
            )
        total = standardised(discriminant)
        if machine is not None:
            total += standardised(machine)
        for classifier, weight, to_stored in zip(self.nearest, self.weights, distances, strict=True):
            total += weight * standardised(-classifier.nearest_by_class(to_stored))
        return total


class FusedRecogniser:
    """Sum of standardised scores: a kernel discriminant, a support vector machine, and the nearest view of each class.

    The discriminant knows what varies within classes, the machine what lies between them; the nearest neighbour, with
    local scaling, knows classes that fall into several kinds. Scores of several views of one object add up.
    nearest_weights: one for each matrix of distances, as the function of this name has them; alike where None.
    """

    def __init__(
        self,
        *,
        shrinkage: float = SHRINKAGE,
        nearest_weights: tuple[float, ...] | None = None,
        local_scaling: int = LOCAL_SCALING,
    ) -> None:
        self._nearest_weights = nearest_weights
        self._discriminant = KernelDiscriminant(shrinkage)
        self._local_scaling = local_scaling
        self.joined = JoinedScores((), ())
        self.multipliers: npt.NDArray[np.float32] | None = None

    @property
    def labels(self) -> npt.NDArray[Any]:
        """Labels (c,) of the columns of scores, sorted."""
        if not len(self._discriminant.labels):
            raise ModelError("FusedRecogniser: not fitted")
        return self._discriminant.labels

    def fit(self, stored: ViewComparison, labels: npt.ArrayLike) -> FusedRecogniser:
        """Learn from how the stored views compare among themselves and their labels (n,)."""
        known = np.asarray(labels)
        self._discriminant.fit(stored.kernel, _for_copies(known, stored.kernel))
        weights = self._nearest_weights
        if weights is None:
            weights = tuple(NEAREST_WEIGHT / len(stored.distances) for _ in stored.distances)
        self.joined = JoinedScores.of_distances(stored.distances, known, self._local_scaling, weights)
        self.multipliers = (
            None if stored.machine_kernel is None else _machine_multipliers(stored.machine_kernel, known)
        )
        return self

    def scores(self, queries: ViewComparison) -> FloatArray:
        """Scores (m, c), larger is better, from how queries compare with the stored views."""
        machine = None
        if self.multipliers is not None:
            if queries.machine_kernel is None or queries.machine_kernel.shape[1] != len(self.multipliers):
                raise DataError(
                    f"FusedRecogniser: expected a machine kernel (m, {len(self.multipliers)}), "
                    f"got {None if queries.machine_kernel is None else queries.machine_kernel.shape}"
                )
            machine = np.asarray(queries.machine_kernel @ self.multipliers, dtype=np.float64)
        return self.joined.of(self._discriminant.scores(queries.kernel), machine, queries.distances)

    @property
    def discriminant(self) -> tuple[FloatArray, FloatArray]:
        """Weights (k n, c) of kernel values and offsets (c,), which make the discriminant's scores."""
        return self._discriminant.weights, self._discriminant.offsets


def _machine_multipliers(
    kernel: npt.NDArray[np.floating[Any]], labels: npt.NDArray[Any]
) -> npt.NDArray[np.float32]:
    from depthprint.baselines.linear_svm import GramSvm

    values = np.asarray(kernel, dtype=np.float32)
    return GramSvm(MACHINE_C).fit(values, _for_copies(labels, values)).multipliers


def _for_copies(labels: npt.NDArray[Any], among: npt.NDArray[np.floating[Any]]) -> npt.NDArray[Any]:
    """Labels of all rows: those of the views, and again for each further copy of them."""
    return np.tile(labels, len(among) // max(1, len(labels)))


def standardised(scores: FloatArray) -> FloatArray:
    """Each row with mean 0 and deviation 1, so that scores of different kinds can be added."""
    centred = scores - scores.mean(axis=1, keepdims=True)
    return np.asarray(centred / np.maximum(centred.std(axis=1, keepdims=True), 1e-12))
