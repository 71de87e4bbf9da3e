"""Nearest-complexity classification: an object is of the class of the nearest stored object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils import assert_all_finite
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_array, check_is_fitted, column_or_1d, validate_data

from depthprint.errors import DataError, SettingsError

__all__ = ["ClassRanking", "NearestComplexityClassifier"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class ClassRanking:
    """All classes of each query, nearest first; arrays (n_queries, n_classes), read-only.

    labels: class labels. distances: distance to the nearest stored object of the class (after local
    scaling, if any). neighbours: index of that stored object.
    """

    labels: npt.NDArray[Any]
    distances: FloatArray
    neighbours: IntArray

    def __post_init__(self) -> None:
        for array in (self.labels, self.distances, self.neighbours):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.labels)


class NearestComplexityClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Class of the nearest stored object, from distances that were computed beforehand (paper section IV).

    n_neighbors: stored objects that vote; a tie goes to the class whose voters are nearer on average.
    local_scaling: 0 for none, else m > 0: a distance d(q, t) becomes d / sqrt(s_q s_t), with s the distance
        of a query or stored object to its m-th nearest stored object other than itself (Zelnik-Manor & Perona
        2004, here on the distance itself). It lifts the handicap of objects in sparse regions.
        ``scales_``: s of the stored objects (n,), None for none.
    metric: only 'precomputed': X holds distances, (n_train, n_train) in ``fit``, (n_query, n_train) later.

    A scikit-learn estimator: malformed input raises DataError, which is a ValueError, as it expects; use
    before ``fit`` raises its NotFittedError.
    """

    def __init__(self, n_neighbors: int = 1, *, local_scaling: int = 0, metric: str = "precomputed") -> None:
        self.n_neighbors = n_neighbors
        self.local_scaling = local_scaling
        self.metric = metric

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.pairwise = self.metric == "precomputed"
        tags.input_tags.positive_only = True
        return tags

    def fit(self, X: npt.ArrayLike | None, y: npt.ArrayLike) -> NearestComplexityClassifier:
        """Store the labels, and the scale of each stored object where local scaling is asked for.

        X: (n, n) distances >= 0 between the stored objects; may be None without local scaling, since then
            nothing is taken from it. y: (n,) labels.
        Raises SettingsError for parameters out of range, DataError for malformed distances or labels.
        """
        self._check_parameters()
        if y is None:
            raise DataError(
                "NearestComplexityClassifier requires y to be passed, but the target y is None: "
                "expected labels (n,)"
            )
        try:
            labels = column_or_1d(y, warn=True)
            assert_all_finite(labels, input_name="y")
            check_classification_targets(labels)
            distances = None if X is None else validate_data(self, X, dtype=np.float64)
        except ValueError as error:
            raise DataError(str(error)) from error
        n = len(labels)
        if n == 0:
            raise DataError("NearestComplexityClassifier: expected at least one stored object, got none")
        self.scales_ = None
        if distances is None:
            if self.local_scaling:
                raise DataError(
                    "NearestComplexityClassifier: local scaling needs the distances of the stored objects"
                )
            self.n_features_in_ = n
        elif distances.shape != (n, n):
            raise DataError(
                f"NearestComplexityClassifier: expected distances ({n}, {n}) for {n} labels, "
                f"got {distances.shape}"
            )
        else:
            _require_non_negative(distances)
        if not max(self.n_neighbors, self.local_scaling + bool(self.local_scaling)) <= n:
            raise DataError(
                f"NearestComplexityClassifier: {n} stored objects are too few for "
                f"n_neighbors={self.n_neighbors}, local_scaling={self.local_scaling} (n_samples={n})"
            )
        self._know(labels)
        if self.local_scaling and distances is not None:
            others = distances.copy()
            np.fill_diagonal(others, np.inf)
            self.scales_ = _mth_smallest(others, self.local_scaling)
        return self

    def restore(self, scales: npt.ArrayLike, y: npt.ArrayLike) -> NearestComplexityClassifier:
        """Take up what ``fit`` learned before: ``scales_`` (n,) and the labels (n,).

        Raises DataError for scales of another number, not finite or negative.
        """
        labels, found = np.asarray(y), np.asarray(scales, dtype=np.float64)
        if found.shape != (len(labels),) or not (np.isfinite(found).all() and (found >= 0).all()):
            raise DataError(
                f"NearestComplexityClassifier: expected finite scales >= 0 of {len(labels)} objects, "
                f"got shape {found.shape}"
            )
        self.n_features_in_ = len(labels)
        self.scales_ = found
        self._know(labels)
        return self

    def _know(self, labels: npt.NDArray[Any]) -> None:
        self.classes_, self._encoded = np.unique(labels, return_inverse=True)
        self._by_class = np.argsort(self._encoded, kind="stable")
        self._class_starts = np.searchsorted(self._encoded[self._by_class], np.arange(len(self.classes_)))

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """Label of each query, (n_query,), from distances X (n_query, n_train)."""
        distances, indices = self.kneighbors(X)
        votes = self._encoded[indices]
        winners = votes[:, 0].copy()
        if votes.shape[1] > 1:
            n_classes = len(self.classes_)
            for row, (vote, distance) in enumerate(zip(votes, distances, strict=True)):
                counts = np.bincount(vote, minlength=n_classes)
                totals = np.bincount(vote, weights=distance, minlength=n_classes)
                tied = np.flatnonzero(counts == counts.max())
                winners[row] = tied[np.argmin(totals[tied])]
        return np.asarray(self.classes_[winners])

    def kneighbors(self, X: npt.ArrayLike, n_neighbors: int | None = None) -> tuple[FloatArray, IntArray]:
        """Distances (n_query, k) and indices (n_query, k) of the nearest stored objects, nearest first.

        Equal distances keep the order in which the objects were stored. Raises DataError for distances that
        are not (n_query, n_train), finite and >= 0; SettingsError for k outside 1..n_train.
        """
        scaled = self._scaled(X)
        k = self.n_neighbors if n_neighbors is None else n_neighbors
        if not 1 <= k <= scaled.shape[1]:
            raise SettingsError(f"kneighbors: expected 1 <= n_neighbors <= {scaled.shape[1]}, got {k}")
        indices = np.argsort(scaled, axis=1, kind="stable")[:, :k]
        return np.take_along_axis(scaled, indices, axis=1), indices

    def predict_with_distances(self, X: npt.ArrayLike) -> ClassRanking:
        """Every class with the distance to its nearest stored object, nearest class first, for each query."""
        scaled = self._scaled(X)
        n_classes = len(self.classes_)
        nearest = np.empty((len(scaled), n_classes), dtype=np.int64)
        for c in range(n_classes):
            members = np.flatnonzero(self._encoded == c)
            nearest[:, c] = members[np.argmin(scaled[:, members], axis=1)]
        distances = np.take_along_axis(scaled, nearest, axis=1)
        order = np.argsort(distances, axis=1, kind="stable")
        return ClassRanking(
            np.asarray(self.classes_[order]),
            np.take_along_axis(distances, order, axis=1),
            np.take_along_axis(nearest, order, axis=1),
        )

    def nearest_by_class(self, X: npt.ArrayLike) -> FloatArray:
        """Distance (n_query, c) of each query to the nearest stored object of each class, columns as ``classes_``."""
        scaled = self._scaled(X)
        return np.asarray(np.minimum.reduceat(scaled[:, self._by_class], self._class_starts, axis=1))

    def _check_parameters(self) -> None:
        if self.metric != "precomputed":
            raise SettingsError(
                f"NearestComplexityClassifier: expected metric 'precomputed', got {self.metric!r}"
            )
        if not _is_integer(self.n_neighbors) or self.n_neighbors < 1:
            raise SettingsError(
                f"NearestComplexityClassifier: expected n_neighbors >= 1, got {self.n_neighbors!r}"
            )
        if not _is_integer(self.local_scaling) or self.local_scaling < 0:
            raise SettingsError(
                f"NearestComplexityClassifier: expected local_scaling >= 0, got {self.local_scaling!r}"
            )

    def _scaled(self, X: npt.ArrayLike) -> FloatArray:
        check_is_fitted(self, "classes_")
        try:
            if hasattr(self, "feature_names_in_"):
                distances = validate_data(self, X, dtype=np.float64, reset=False)
            else:
                distances = check_array(X, dtype=np.float64, estimator=self)
        except ValueError as error:
            raise DataError(str(error)) from error
        if distances.shape[1] != self.n_features_in_:
            raise DataError(
                f"X has {distances.shape[1]} features, but NearestComplexityClassifier is expecting "
                f"{self.n_features_in_} features as input: the distances to the stored objects, in order"
            )
        _require_non_negative(distances)
        if self.scales_ is None:
            return np.asarray(distances)
        query_scales = _mth_smallest(distances, self.local_scaling)
        product = np.sqrt(query_scales[:, None] * self.scales_[None, :])
        # A zero scale means duplicates at distance zero; the smallest positive number keeps 0/0 out.
        return np.asarray(distances / np.maximum(product, np.finfo(np.float64).tiny ** 0.5))


def _is_integer(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _require_non_negative(distances: FloatArray) -> None:
    if (distances < 0).any():
        raise DataError(
            f"NearestComplexityClassifier: expected distances >= 0, got {distances.min():g} "
            "(Negative values in data)"
        )


def _mth_smallest(distances: FloatArray, m: int) -> FloatArray:
    return np.asarray(np.partition(distances, m - 1, axis=1)[:, m - 1])
