"""Methods that name objects, whose proposals are checked by aligning the query with their best few stored views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from depthprint.evaluation.object_methods import ObjectMethod
from depthprint.objects.alignment import aligned_agreements, checked_scores
from depthprint.range_image import RangeImage

if TYPE_CHECKING:
    from depthprint._kernels.surface_alignment import SeenSurface

__all__ = ["GeometryChecked", "LikenessMethod", "ViewAgreements"]

Progress = Callable[[int, int], None]
IndexArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]


class LikenessMethod(ObjectMethod, Protocol):
    """An object method that grades every label, and every stored view."""

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[FloatArray, IndexArray]:
        """Scores (n_test, n_labels), and the labels of their columns."""

    def likeness(self, train: IndexArray, test: IndexArray) -> npt.NDArray[np.float32]:
        """How like (n_test, n_train) training views are, larger is liker."""


class ViewAgreements:
    """Surfaces of views and how pairs of them agree, each computed when first asked for; methods may share one."""

    def __init__(self) -> None:
        self._images: Sequence[RangeImage] = ()
        self._surfaces: dict[int, SeenSurface] = {}
        self._known: dict[tuple[int, int], float] = {}

    def prepare(self, images: Sequence[RangeImage]) -> None:
        """Take views; those given last are kept with all that is known of them."""
        if images is not self._images:
            self._images = images
            self._surfaces.clear()
            self._known.clear()

    def between(self, query: int, stored: IndexArray) -> FloatArray:
        """Agreement (n,) of a view with others, by their numbers; raises as ``object_surface`` does."""
        missing = [int(k) for k in stored if (query, int(k)) not in self._known]
        if missing:
            found = aligned_agreements(self._surface(query), [self._surface(k) for k in missing])
            self._known.update(((query, k), float(value)) for k, value in zip(missing, found, strict=True))
        return np.array([self._known[query, int(k)] for k in stored])

    def _surface(self, number: int) -> SeenSurface:
        if number not in self._surfaces:
            from depthprint.object_surface import object_surface

            self._surfaces[number] = object_surface(self._images[number])
        return self._surfaces[number]


class GeometryChecked:
    """Scores of a method that proposes, and the agreement of the best alignment with each class it thinks best of.

    weight: of the agreement beside scores of deviation 1. ``proposer`` is the method as it is without this check.
    """

    def __init__(
        self, name: str, proposer: LikenessMethod, weight: float, agreements: ViewAgreements | None = None
    ) -> None:
        self.name = name
        self.proposer = proposer
        self.us_per_pair = float("nan")
        self.agreements = ViewAgreements() if agreements is None else agreements
        self._weight = weight

    @property
    def bytes_per_pair(self) -> float:
        """That of the method that proposes; 0 where it compares no pairs."""
        return float(getattr(self.proposer, "bytes_per_pair", 0.0))

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Let the proposer see all views; surfaces are made of those that are aligned."""
        self.proposer.prepare(images, progress)
        self.us_per_pair = self.proposer.us_per_pair
        self.agreements.prepare(images)

    def predict(self, train: IndexArray, train_labels: IndexArray, test: IndexArray) -> IndexArray:
        """Label of the highest score, for each test view."""
        scores, labels = self.scores(train, train_labels, test)
        return np.asarray(labels[scores.argmax(axis=1)])

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[FloatArray, IndexArray]:
        """Scores (n_test, n_labels), larger is better, and the labels of their columns."""
        proposed, labels = self.proposer.scores(train, train_labels, test)
        likeness = self.proposer.likeness(train, test)

        def agreements_with(query: int, views: IndexArray) -> FloatArray:
            return self.agreements.between(int(test[query]), train[views])

        checked = checked_scores(proposed, labels, train_labels, likeness, agreements_with, self._weight)
        return checked, labels
