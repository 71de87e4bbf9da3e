"""What an object method is to the protocol, and the plain one: nearest neighbour over distances."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.range_image import RangeImage

if TYPE_CHECKING:
    from depthprint.classification import NearestComplexityClassifier

__all__ = ["NeighbourMethod", "ObjectMethod", "PrecomputedDistanceMethod", "ScoringMethod"]

Progress = Callable[[int, int], None]
IndexArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]


class ObjectMethod(Protocol):
    """A method that names the class of a view.

    ``us_per_pair`` is set by ``prepare``; NaN where it has no meaning.
    """

    name: str
    us_per_pair: float

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """See all views once, without labels: describe them, and learn nothing from what is tested."""

    def predict(self, train: IndexArray, train_labels: IndexArray, test: IndexArray) -> IndexArray:
        """Label the views ``test`` from the views ``train`` and their labels; numbers index ``images``."""


@runtime_checkable
class ScoringMethod(Protocol):
    """An ``ObjectMethod`` that also grades every label, so that several views of one object can be summed."""

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[FloatArray, IndexArray]:
        """Scores (n_test, n_labels), larger is better, and the labels (n_labels,) of their columns."""


@runtime_checkable
class NeighbourMethod(Protocol):
    """An ``ObjectMethod`` that can also say which stored views decided."""

    def neighbours(self, train: IndexArray, test: IndexArray, k: int) -> IndexArray:
        """Numbers (n_test, k) of the nearest training views, nearest first."""


class PrecomputedDistanceMethod:
    """Nearest neighbour over distances of all pairs of views, computed once.

    distance_matrix_fn: (images, progress) -> (n, n) symmetric, finite. With ``describe_fn`` it is given
    ``describe_fn(images, progress)`` in their place, and ``us_per_pair`` leaves the description out: the time
    of the matrix by the number of distinct pairs. ``local_scaling``: as NearestComplexityClassifier has it.
    Of views equally near, the first wins.
    """

    def __init__(
        self,
        distance_matrix_fn: Callable[[Any, Progress | None], npt.NDArray[np.floating[Any]]],
        name: str,
        describe_fn: Callable[[Sequence[RangeImage], Progress | None], Any] | None = None,
        local_scaling: int = 0,
    ) -> None:
        self.name = name
        self.us_per_pair = float("nan")
        self._distance_matrix_fn = distance_matrix_fn
        self._describe_fn = describe_fn
        self._local_scaling = local_scaling
        self._distances: npt.NDArray[np.floating[Any]] | None = None

    @property
    def bytes_per_pair(self) -> float:
        """Memory at its peak over the square of the number of views: the distances, and a copy or two of them."""
        return 24.0

    @property
    def distances(self) -> npt.NDArray[np.floating[Any]]:
        """The (n, n) matrix, read-only; DataError before ``prepare``."""
        if self._distances is None:
            raise DataError(
                f"method {self.name!r}: expected prepare() to be called before its distances are used"
            )
        return self._distances

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Compute the distances of all pairs; DataError for a matrix of another shape or not finite."""
        described = images if self._describe_fn is None else self._describe_fn(images, progress)
        started = time.perf_counter()
        distances = np.asarray(self._distance_matrix_fn(described, progress))
        elapsed_s = time.perf_counter() - started
        n = len(images)
        if distances.shape != (n, n):
            raise DataError(f"method {self.name!r}: expected distances ({n}, {n}), got {distances.shape}")
        if not np.isfinite(distances).all():
            first, second = np.argwhere(~np.isfinite(distances))[0]
            raise DataError(f"method {self.name!r}: the distance of views {first} and {second} is not finite")
        distances = distances.view()
        distances.setflags(write=False)
        self._distances = distances
        self.us_per_pair = elapsed_s * 1e6 / max(1, n * (n - 1) // 2)

    def predict(self, train: IndexArray, train_labels: IndexArray, test: IndexArray) -> IndexArray:
        """Label of the nearest training view, for each test view."""
        classifier = self._fitted(train, train_labels)
        return np.asarray(classifier.predict(self.distances[np.ix_(test, train)]))

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[FloatArray, IndexArray]:
        """Negated distance to the nearest training view of each label."""
        classifier = self._fitted(train, train_labels)
        nearest = classifier.nearest_by_class(self.distances[np.ix_(test, train)])
        return -nearest, np.asarray(classifier.classes_)

    def neighbours(self, train: IndexArray, test: IndexArray, k: int) -> IndexArray:
        """Numbers (n_test, k) of the nearest training views, nearest first."""
        classifier = self._fitted(train, np.zeros(len(train), dtype=np.int64))
        _, nearest = classifier.kneighbors(self.distances[np.ix_(test, train)], k)
        return train[nearest]

    def _fitted(self, train: IndexArray, train_labels: IndexArray) -> NearestComplexityClassifier:
        from depthprint.classification import NearestComplexityClassifier

        classifier = NearestComplexityClassifier(local_scaling=self._local_scaling)
        among_training = self.distances[np.ix_(train, train)] if self._local_scaling else None
        return classifier.fit(among_training, train_labels)
