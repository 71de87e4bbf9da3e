"""The object protocols: category (one object of each left out, every object tested once) and instance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import ObjectSet, ObjectView
from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.memory import machine_bytes, require_room_for_pairs
from depthprint.evaluation.metrics import Interval
from depthprint.evaluation.object_methods import ObjectMethod, ScoringMethod
from depthprint.evaluation.object_queries import turn_queries
from depthprint.evaluation.object_splits import (
    category_folds,
    instance_split,
    named_trials,
    random_trials,
    select_views,
)
from depthprint.partial_views import hide_part

__all__ = [
    "OBJECT_PROTOCOL",
    "MethodObjects",
    "ObjectEvaluation",
    "ObjectProtocol",
    "PairedDifference",
    "evaluate_objects",
    "paired_difference",
]

OBJECT_PROTOCOL = "objects: category, one of each left out; instance, 30 and 60 deg against 45 deg"
NOISE_LIMIT = 2.5

Progress = Callable[[int, int], None]
IndexArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PairedDifference:
    """Mean of ``first`` minus ``second`` over the same objects, and its standard error."""

    first: str
    second: str
    mean: float
    standard_error: float

    @property
    def is_noise(self) -> bool:
        """Whether the difference is under 2.5 of its standard errors."""
        return not abs(self.mean) >= NOISE_LIMIT * self.standard_error or self.mean == 0


@dataclass(frozen=True)
class ObjectProtocol:
    """What a query is, and how objects are left out.

    views_per_query: consecutive views of a turn whose scores are summed, one query beginning at each view.
    hidden: share of each query's object that a random half-plane hides, cropped anew around the rest.
    trials: 0 tests every object once; else so many random trials (10 in the literature, 20 in the paper).
    left_out: instances left out in each trial, as published for a set; goes before ``trials``.
    """

    views_per_query: int = 1
    hidden: float = 0.0
    trials: int = 0
    left_out: tuple[tuple[str, ...], ...] = ()

    def splits(self, views: Sequence[ObjectView], seed: int) -> list[tuple[IndexArray, IndexArray]]:
        """Train and test view numbers of each fold or trial of the category protocol."""
        if self.left_out:
            return named_trials(views, self.left_out)
        return random_trials(views, self.trials, seed) if self.trials else category_folds(views, seed)

    @property
    def words(self) -> str:
        """The protocol's name for reports."""
        left_out = "one of each left out"
        if self.left_out:
            left_out = f"{len(self.left_out)} published trials"
        elif self.trials:
            left_out = f"{self.trials} random trials"
        words = OBJECT_PROTOCOL.replace("one of each left out", left_out)
        if self.views_per_query > 1:
            words += f"; queries of {self.views_per_query} views"
        return words + (f"; {self.hidden:.0%} of each query hidden" if self.hidden else "")


@dataclass(frozen=True)
class MethodObjects:
    """What one method did.

    category_predictions: (n,) int64 number of the predicted category of each view, the last where it was tested
        several times; -1 where it was not.
    fold_accuracies: accuracy of each fold, over views, averaged by category.
    object_accuracies: share of each object's views put in its category, in the order of
    ``ObjectEvaluation.objects``.
    instance_accuracies: the same for its own instance, over the views tested; NaN for objects that had none.
    intervals: bootstrap 95 % intervals over objects.
    """

    name: str
    category_predictions: IndexArray
    fold_accuracies: tuple[float, ...]
    object_accuracies: FloatArray
    instance_accuracy: float
    instance_accuracies: FloatArray
    us_per_pair: float
    intervals: Mapping[str, Interval]

    @property
    def category_accuracy_mean(self) -> float:
        """Mean over folds."""
        return float(np.mean(self.fold_accuracies))

    @property
    def category_accuracy_std(self) -> float:
        """Sample standard deviation over folds; NaN for a single one."""
        if len(self.fold_accuracies) < 2:
            return float("nan")
        return float(np.std(self.fold_accuracies, ddof=1))


@dataclass(frozen=True)
class ObjectEvaluation:
    """All methods on one set of views; ``objects`` (instances) and ``categories`` are names, sorted."""

    data: str
    simulated: bool
    seed: int
    frames: tuple[int, ...] | None
    protocol: ObjectProtocol
    views: tuple[ObjectView, ...]
    categories: tuple[str, ...]
    objects: tuple[str, ...]
    n_instance_tests: int
    methods: tuple[MethodObjects, ...]
    category_differences: tuple[PairedDifference, ...]
    instance_differences: tuple[PairedDifference, ...]

    def confusion(self, method: MethodObjects) -> IndexArray:
        """(c, c) number of views by true (row) and predicted (column) category."""
        c = len(self.categories)
        truth = _numbers([v.category for v in self.views], self.categories)
        tested = method.category_predictions >= 0
        return (
            np.bincount((truth * c + method.category_predictions)[tested], minlength=c * c)
            .reshape(c, c)
            .astype(np.int64)
        )


def paired_difference(first: str, second: str, a: FloatArray, b: FloatArray) -> PairedDifference:
    """Compare two methods by accuracies on the same objects, (o,) each; objects with NaN are left out."""
    difference = np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64)
    difference = difference[np.isfinite(difference)]
    if len(difference) < 2:
        raise DataError(
            f"paired difference of {first} and {second}: expected two objects or more, got {len(difference)}"
        )
    error = float(np.std(difference, ddof=1) / np.sqrt(len(difference)))
    return PairedDifference(first, second, float(difference.mean()), error)


def evaluate_objects(
    objects: ObjectSet,
    methods: Sequence[ObjectMethod],
    *,
    seed: int = 0,
    frames: Sequence[int] | None = None,
    protocol: ObjectProtocol = ObjectProtocol(),
    progress: Progress | None = None,
) -> ObjectEvaluation:
    """Run every method through the category splits and the instance split.

    ``frames`` takes those views of each turn only. All views are read once and given to each method's
    ``prepare``; ``progress`` counts the methods' own work one method after the other. Instance accuracy is
    over all tested views, NaN where the set has no views at the elevations needed.
    Raises DataError for sets that the protocol cannot be run on, more views than this machine can compare in pairs,
    or labels of a wrong kind from a method;
    SettingsError for methods of one name, and for queries of several views to a method without ``scores``.
    """
    if not methods or len({m.name for m in methods}) != len(methods):
        raise SettingsError("evaluate_objects: expected methods with different names, at least one")
    mute = [m.name for m in methods if not isinstance(m, ScoringMethod)]
    if protocol.views_per_query > 1 and mute:
        raise SettingsError(
            f"{mute[0]}: grades no labels, so queries of {protocol.views_per_query} views cannot be summed"
        )
    views = select_views(objects, frames)
    folds = protocol.splits(views, seed)
    train, test = instance_split(views, objects.elevation_deg)
    categories = tuple(sorted({v.category for v in views}))
    names = tuple(sorted({v.instance for v in views}))
    category_of = _numbers([v.category for v in views], categories)
    instance_of = _numbers([v.instance for v in views], names)
    unseen = set(instance_of[test].tolist()) - set(instance_of[train].tolist())
    if len(train) and unseen:
        raise DataError(f"{objects.name}: object {names[min(unseen)]} is tested but has no view to train on")
    n_images = len(views) * (2 if protocol.hidden else 1)
    require_room_for_pairs(objects.name, methods, n_images, machine_bytes())
    images = [objects.read(view) for view in views]
    if protocol.hidden:
        images += [
            hide_part(image, protocol.hidden, np.random.default_rng([seed, number]))
            for number, image in enumerate(images)
        ]
    results = []
    for method in methods:
        method.prepare(images, progress)
        predicted = np.full(len(views), -1, dtype=np.int64)
        times, hits = np.zeros(len(views)), np.zeros(len(views))
        fold_accuracies = []
        for fold_train, fold_test in folds:
            predicted[fold_test] = _predict(method, fold_train, category_of, fold_test, views, protocol)
            correct = predicted[fold_test] == category_of[fold_test]
            times[fold_test] += 1
            hits[fold_test] += correct
            fold_accuracies.append(
                float(np.nanmean(_mean_by(correct, category_of[fold_test], len(categories))))
            )
        right = np.full(0, False)
        if len(train) and len(test):
            right = _predict(method, train, instance_of, test, views, protocol) == instance_of[test]
        by_object = _mean_by(hits, instance_of, len(names), times)
        by_instance = _mean_by(right, instance_of[test[: len(right)]], len(names))
        results.append(
            MethodObjects(
                name=method.name,
                category_predictions=predicted,
                fold_accuracies=tuple(fold_accuracies),
                object_accuracies=by_object,
                instance_accuracy=float(right.mean()) if len(right) else float("nan"),
                instance_accuracies=by_instance,
                us_per_pair=float(method.us_per_pair),
                intervals={
                    "category_accuracy_mean": _mean_interval(by_object, seed),
                    "instance_accuracy": _mean_interval(by_instance, seed),
                },
            )
        )
    pairs = [(a, b) for k, a in enumerate(results) for b in results[k + 1 :]]
    return ObjectEvaluation(
        data=objects.name,
        simulated=objects.simulated,
        seed=seed,
        frames=None if frames is None else tuple(frames),
        protocol=protocol,
        views=views,
        categories=categories,
        objects=names,
        n_instance_tests=len(test) if len(train) else 0,
        methods=tuple(results),
        category_differences=tuple(
            paired_difference(a.name, b.name, a.object_accuracies, b.object_accuracies) for a, b in pairs
        ),
        instance_differences=tuple(
            paired_difference(a.name, b.name, a.instance_accuracies, b.instance_accuracies)
            for a, b in pairs
            if np.isfinite(a.instance_accuracies).sum() > 1
        ),
    )


def _predict(
    method: ObjectMethod,
    train: IndexArray,
    labels: IndexArray,
    test: IndexArray,
    views: Sequence[ObjectView],
    protocol: ObjectProtocol,
) -> IndexArray:
    # Images of partly hidden objects follow the whole ones.
    queries = test + len(views) if protocol.hidden else test
    if protocol.views_per_query > 1 and isinstance(method, ScoringMethod):
        scores, columns = method.scores(train, labels[train], queries)
        together = turn_queries(views, test, protocol.views_per_query)
        predicted = np.asarray(columns)[scores[together].sum(axis=1).argmax(axis=1)]
    else:
        predicted = np.asarray(method.predict(train, labels[train], queries))
    if predicted.shape != test.shape or not np.isin(predicted, labels).all():
        raise DataError(
            f"method {method.name!r}: expected {len(test)} known labels, got shape {predicted.shape}"
        )
    return np.asarray(predicted, dtype=np.int64)


def _numbers(values: Sequence[str], names: Sequence[str]) -> IndexArray:
    number = {name: k for k, name in enumerate(names)}
    return np.array([number[value] for value in values], dtype=np.int64)


def _mean_by(
    values: npt.NDArray[Any], groups: IndexArray, n_groups: int, counts: FloatArray | None = None
) -> FloatArray:
    """Sum of ``values`` by group over the sum of ``counts`` (1 each when None); NaN for groups without."""
    total = np.bincount(groups, weights=values.astype(np.float64), minlength=n_groups)
    count = np.bincount(groups, weights=counts, minlength=n_groups)
    return np.asarray(np.divide(total, count, out=np.full(n_groups, np.nan), where=count > 0))


def _mean_interval(by_object: FloatArray, seed: int, resamples: int = 1000) -> Interval:
    known = by_object[np.isfinite(by_object)]
    if not len(known):
        return float("nan"), float("nan")
    draws = np.random.default_rng(seed).integers(0, len(known), size=(resamples, len(known)))
    low, high = np.percentile(known[draws].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)
