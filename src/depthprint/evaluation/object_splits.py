"""What the object protocols train on and test on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import ObjectSet, ObjectView
from depthprint.errors import DataError, SettingsError

__all__ = ["category_folds", "instance_split", "named_trials", "random_trials", "select_views"]

TRAIN_ELEVATIONS_DEG = (30, 60)
TEST_ELEVATION_DEG = 45

IndexArray = npt.NDArray[np.int64]
Split = tuple[IndexArray, IndexArray]


def select_views(objects: ObjectSet, frames: Sequence[int] | None = None) -> tuple[ObjectView, ...]:
    """Views of every turn with a frame number among ``frames`` (None: all); DataError for unknown numbers."""
    if frames is None:
        return tuple(objects.views)
    missing = sorted(set(frames) - {v.frame for v in objects.views})
    if missing or not frames:
        raise DataError(f"{objects.name}: expected frame numbers that the set has, got {missing or 'none'}")
    wanted = set(frames)
    return tuple(v for v in objects.views if v.frame in wanted)


def category_folds(views: Sequence[ObjectView], seed: int) -> list[Split]:
    """Split views into folds that leave one object of each category out, each object in exactly one.

    Returns (train, test) view numbers a fold, as many folds as the largest category has objects; the order
    within each category is drawn by ``seed``. A smaller category is not tested in the last folds.
    Raises DataError for a category of one object, which could never be learned.
    """
    by_category = _by_category(views)
    generator = np.random.default_rng(seed)
    order = {
        c: [instances[k] for k in generator.permutation(len(instances))]
        for c, instances in by_category.items()
    }
    folds = []
    for fold in range(max(len(instances) for instances in order.values())):
        left_out = {(c, instances[fold]) for c, instances in order.items() if fold < len(instances)}
        folds.append(_leave_out(views, left_out))
    return folds


def instance_split(views: Sequence[ObjectView], elevation_deg: Mapping[int, float]) -> Split:
    """View numbers to train on (30 and 60 deg, videos 1 and 4) and to test on (45 deg, video 2)."""
    elevations = np.array([elevation_deg.get(v.video, np.nan) for v in views])
    train = np.flatnonzero(np.isin(elevations, TRAIN_ELEVATIONS_DEG)).astype(np.int64)
    test = np.flatnonzero(elevations == TEST_ELEVATION_DEG).astype(np.int64)
    return train, test


def random_trials(views: Sequence[ObjectView], n_trials: int, seed: int) -> list[Split]:
    """Leave one object of each category out, drawn anew for each trial: the literature's 10 trials, the paper's 20.

    Returns (train, test) view numbers a trial; an object may be tested in several, or in none. Raises DataError for a
    category of one object, SettingsError for fewer than one trial.
    """
    if n_trials < 1:
        raise SettingsError(f"trials: expected 1 or more, got {n_trials}")
    generator = np.random.default_rng(seed)
    by_category = _by_category(views)
    return [
        _leave_out(views, {(c, names[generator.integers(len(names))]) for c, names in by_category.items()})
        for _ in range(n_trials)
    ]


def named_trials(views: Sequence[ObjectView], trials: Sequence[Sequence[str]]) -> list[Split]:
    """Leave out the instances that each trial names, as a published list of trials does.

    Returns (train, test) view numbers a trial. Raises DataError for a trial without views of its own.
    """
    category_of = {v.instance: v.category for v in views}
    splits = []
    for number, trial in enumerate(trials, start=1):
        left_out = {(category_of[instance], instance) for instance in trial if instance in category_of}
        if not left_out:
            raise DataError(f"trial {number}: none of its instances is among the views")
        splits.append(_leave_out(views, left_out))
    return splits


def _by_category(views: Sequence[ObjectView]) -> dict[str, list[str]]:
    by_category: dict[str, list[str]] = {}
    for category, instance in sorted({(v.category, v.instance) for v in views}):
        by_category.setdefault(category, []).append(instance)
    alone = [category for category, instances in by_category.items() if len(instances) < 2]
    if alone or not by_category:
        raise DataError(
            f"category protocol: expected two objects or more in each category, not so: {alone or 'no views'}"
        )
    return by_category


def _leave_out(views: Sequence[ObjectView], left_out: set[tuple[str, str]]) -> Split:
    tested = np.array([(v.category, v.instance) in left_out for v in views])
    return np.flatnonzero(~tested).astype(np.int64), np.flatnonzero(tested).astype(np.int64)
