"""From scores to probabilities, with "none of these" among the outcomes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["Calibration", "calibrate", "novelty_features"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
# Views to learn from, their labels, views to ask -> (scores (m, c), nearest distance (m,)).
Scorer = Callable[[IntArray, npt.NDArray[Any], IntArray], tuple[FloatArray, FloatArray]]

FOLDS = 5
_TEMPERATURES = np.geomspace(0.02, 50.0, 100)


@dataclass(frozen=True)
class Calibration:
    """Softmax temperature, and a logistic regression that tells known classes from unknown ones.

    novelty: weights of the features of ``novelty_features`` and the intercept, of P(known); None where fewer than three
    classes were there to learn it from, and everything then counts as known.
    """

    temperature: float
    novelty: tuple[float, ...] | None

    def probabilities(self, scores: FloatArray, nearest: float) -> tuple[FloatArray, float]:
        """Probabilities (c,) of the classes and that of none of them, which add up to 1."""
        shares = np.exp((scores - scores.max()) / self.temperature)
        shares /= shares.sum()
        if self.novelty is None:
            return shares, 0.0
        features = novelty_features(scores[None], np.array([nearest]))[0]
        logit = float(features @ self.novelty[:-1]) + self.novelty[-1]
        known = float(1.0 / (1.0 + np.exp(-np.clip(logit, -30.0, 30.0))))
        return shares * known, 1.0 - known


def novelty_features(scores: FloatArray, nearest: FloatArray) -> FloatArray:
    """What tells a known class: a high best score, its lead over the second, a near stored view; (m, 3)."""
    ordered = np.sort(scores, axis=1)
    return np.stack([ordered[:, -1], ordered[:, -1] - ordered[:, -2], -nearest], axis=1)


def calibrate(scorer: Scorer, labels: npt.NDArray[Any], groups: npt.NDArray[Any], seed: int) -> Calibration:
    """Learn both from the stored views, by leaving out objects (``groups``), and by leaving out classes.

    The temperature maximises the likelihood of left-out views whose class has other objects; views of left-out classes
    are the examples of unknown ones.
    """
    known_scores, known_nearest, truth = _left_out_objects(scorer, labels, groups, seed)
    classes = np.unique(labels)
    if not len(truth):
        return Calibration(1.0, None)
    right = np.searchsorted(classes, truth)
    losses = []
    for temperature in _TEMPERATURES:
        logits = (known_scores - known_scores.max(axis=1, keepdims=True)) / temperature
        losses.append(np.mean(np.log(np.exp(logits).sum(axis=1)) - logits[np.arange(len(right)), right]))
    temperature = float(_TEMPERATURES[int(np.argmin(losses))])
    if len(classes) < 3:
        return Calibration(temperature, None)
    unknown_scores, unknown_nearest = _left_out_classes(scorer, labels, seed)
    return Calibration(
        temperature,
        _novelty(
            np.concatenate(
                [
                    novelty_features(known_scores, known_nearest),
                    *(novelty_features(s, n) for s, n in zip(unknown_scores, unknown_nearest, strict=True)),
                ]
            ),
            len(known_scores),
        ),
    )


def _left_out_objects(
    scorer: Scorer, labels: npt.NDArray[Any], groups: npt.NDArray[Any], seed: int
) -> tuple[FloatArray, FloatArray, npt.NDArray[Any]]:
    """Scores of left-out objects of classes that keep another object; the classes stay all the same."""
    generator = np.random.default_rng(seed)
    fold_of = np.full(len(labels), -1)
    for label in np.unique(labels):
        names = np.unique(groups[labels == label])
        if len(names) < 2:
            continue
        for place, name in enumerate(generator.permutation(names)):
            fold_of[(labels == label) & (groups == name)] = place % min(FOLDS, len(names))
    scores, nearest, truth = [], [], []
    for fold in range(fold_of.max() + 1):
        test = np.flatnonzero(fold_of == fold)
        train = np.flatnonzero(fold_of != fold)
        found = scorer(train, labels[train], test)
        scores.append(found[0])
        nearest.append(found[1])
        truth.append(labels[test])
    if not scores:
        return np.empty((0, 0)), np.empty(0), labels[:0]
    return np.concatenate(scores), np.concatenate(nearest), np.concatenate(truth)


def _left_out_classes(
    scorer: Scorer, labels: npt.NDArray[Any], seed: int
) -> tuple[list[FloatArray], list[FloatArray]]:
    classes = np.random.default_rng(seed).permutation(np.unique(labels))
    scores, nearest = [], []
    # Two classes must stay.
    folds = min(FOLDS, len(classes)) if len(classes) > 3 else 3
    for fold in range(folds):
        unknown = np.isin(labels, classes[fold::folds])
        train = np.flatnonzero(~unknown)
        found = scorer(train, labels[train], np.flatnonzero(unknown))
        scores.append(found[0])
        nearest.append(found[1])
    return scores, nearest


def _novelty(features: FloatArray, n_known: int) -> tuple[float, ...]:
    from sklearn.linear_model import LogisticRegression

    known = np.arange(len(features)) < n_known
    spread = np.maximum(features.std(axis=0), 1e-9)
    fitted = LogisticRegression(class_weight="balanced").fit(features / spread, known)
    return (*(fitted.coef_[0] / spread).tolist(), float(fitted.intercept_[0]))
