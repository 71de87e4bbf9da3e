"""The object protocols: category (one object of each left out, every object tested once) and instance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import ObjectSet, ObjectView
from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.metrics import Interval
from depthprint.evaluation.object_methods import ObjectMethod

__all__ = [
    "OBJECT_PROTOCOL",
    "MethodObjects",
    "ObjectEvaluation",
    "PairedDifference",
    "category_folds",
    "evaluate_objects",
    "instance_split",
    "paired_difference",
    "select_views",
]

OBJECT_PROTOCOL = "objects: category, one of each left out; instance, 30 and 60 deg against 45 deg"
TRAIN_ELEVATIONS_DEG = (30, 60)
TEST_ELEVATION_DEG = 45
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
class MethodObjects:
    """What one method did.

    category_predictions: (n,) int64 number of the predicted category of each view.
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
        """Sample standard deviation over folds."""
        return float(np.std(self.fold_accuracies, ddof=1))


@dataclass(frozen=True)
class ObjectEvaluation:
    """All methods on one set of views; ``objects`` (instances) and ``categories`` are names, sorted."""

    data: str
    simulated: bool
    seed: int
    frames: tuple[int, ...] | None
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
        return (
            np.bincount(truth * c + method.category_predictions, minlength=c * c)
            .reshape(c, c)
            .astype(np.int64)
        )


def select_views(objects: ObjectSet, frames: Sequence[int] | None = None) -> tuple[ObjectView, ...]:
    """Views of every turn with a frame number among ``frames`` (None: all); DataError for unknown numbers."""
    if frames is None:
        return tuple(objects.views)
    missing = sorted(set(frames) - {v.frame for v in objects.views})
    if missing or not frames:
        raise DataError(f"{objects.name}: expected frame numbers that the set has, got {missing or 'none'}")
    wanted = set(frames)
    return tuple(v for v in objects.views if v.frame in wanted)


def category_folds(views: Sequence[ObjectView], seed: int) -> list[tuple[IndexArray, IndexArray]]:
    """Split views into folds that leave one object of each category out, each object in exactly one.

    Returns (train, test) view numbers a fold, as many folds as the largest category has objects; the order
    within each category is drawn by ``seed``. A smaller category is not tested in the last folds.
    Raises DataError for a category of one object, which could never be learned.
    """
    by_category: dict[str, list[str]] = {}
    for category, instance in sorted({(v.category, v.instance) for v in views}):
        by_category.setdefault(category, []).append(instance)
    alone = [category for category, instances in by_category.items() if len(instances) < 2]
    if alone or not by_category:
        raise DataError(
            f"category protocol: expected two objects or more in each category, not so: {alone or 'no views'}"
        )
    generator = np.random.default_rng(seed)
    order = {
        c: [instances[k] for k in generator.permutation(len(instances))]
        for c, instances in by_category.items()
    }
    folds = []
    for fold in range(max(len(instances) for instances in order.values())):
        left_out = {(c, instances[fold]) for c, instances in order.items() if fold < len(instances)}
        tested = np.array([(v.category, v.instance) in left_out for v in views])
        folds.append((np.flatnonzero(~tested).astype(np.int64), np.flatnonzero(tested).astype(np.int64)))
    return folds


def instance_split(
    views: Sequence[ObjectView], elevation_deg: Mapping[int, float]
) -> tuple[IndexArray, IndexArray]:
    """View numbers to train on (30 and 60 deg, videos 1 and 4) and to test on (45 deg, video 2)."""
    elevations = np.array([elevation_deg.get(v.video, np.nan) for v in views])
    train = np.flatnonzero(np.isin(elevations, TRAIN_ELEVATIONS_DEG)).astype(np.int64)
    test = np.flatnonzero(elevations == TEST_ELEVATION_DEG).astype(np.int64)
    return train, test


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
    progress: Progress | None = None,
) -> ObjectEvaluation:
    """Run every method through the category folds and the instance split.

    ``frames`` takes those views of each turn only. All views are read once and given to each method's
    ``prepare``; ``progress`` counts the methods' own work one method after the other. Instance accuracy is
    over all tested views, NaN where the set has no views at the elevations needed.
    Raises DataError for sets that the protocol cannot be run on, or labels of a wrong kind from a method.
    """
    if not methods or len({m.name for m in methods}) != len(methods):
        raise SettingsError("evaluate_objects: expected methods with different names, at least one")
    views = select_views(objects, frames)
    folds = category_folds(views, seed)
    train, test = instance_split(views, objects.elevation_deg)
    categories = tuple(sorted({v.category for v in views}))
    names = tuple(sorted({v.instance for v in views}))
    category_of = _numbers([v.category for v in views], categories)
    instance_of = _numbers([v.instance for v in views], names)
    unseen = set(instance_of[test].tolist()) - set(instance_of[train].tolist())
    if len(train) and unseen:
        raise DataError(f"{objects.name}: object {names[min(unseen)]} is tested but has no view to train on")
    images = [objects.read(view) for view in views]
    results = []
    for method in methods:
        method.prepare(images, progress)
        predicted = np.full(len(views), -1, dtype=np.int64)
        fold_accuracies = []
        for fold_train, fold_test in folds:
            predicted[fold_test] = _predict(method, fold_train, category_of, fold_test)
            correct = predicted[fold_test] == category_of[fold_test]
            fold_accuracies.append(
                float(np.nanmean(_mean_by(correct, category_of[fold_test], len(categories))))
            )
        right = np.full(0, False)
        if len(train) and len(test):
            right = _predict(method, train, instance_of, test) == instance_of[test]
        by_object = _mean_by(predicted == category_of, instance_of, len(names))
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


def _predict(method: ObjectMethod, train: IndexArray, labels: IndexArray, test: IndexArray) -> IndexArray:
    predicted = np.asarray(method.predict(train, labels[train], test))
    if predicted.shape != test.shape or not np.isin(predicted, labels).all():
        raise DataError(
            f"method {method.name!r}: expected {len(test)} known labels, got shape {predicted.shape}"
        )
    return predicted.astype(np.int64)


def _numbers(values: Sequence[str], names: Sequence[str]) -> IndexArray:
    number = {name: k for k, name in enumerate(names)}
    return np.array([number[value] for value in values], dtype=np.int64)


def _mean_by(values: npt.NDArray[np.bool_], groups: IndexArray, n_groups: int) -> FloatArray:
    total = np.bincount(groups, weights=values.astype(np.float64), minlength=n_groups)
    count = np.bincount(groups, minlength=n_groups)
    return np.asarray(np.divide(total, count, out=np.full(n_groups, np.nan), where=count > 0))


def _mean_interval(by_object: FloatArray, seed: int, resamples: int = 1000) -> Interval:
    known = by_object[np.isfinite(by_object)]
    if not len(known):
        return float("nan"), float("nan")
    draws = np.random.default_rng(seed).integers(0, len(known), size=(resamples, len(known)))
    low, high = np.percentile(known[draws].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)
