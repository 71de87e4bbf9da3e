"""The nearest-complexity classifier against scikit-learn's neighbours, and its own estimator checks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.model_selection import cross_val_score
from sklearn.neighbors import KNeighborsClassifier
from sklearn.utils.estimator_checks import estimator_checks_generator

from depthprint.classification import NearestComplexityClassifier
from depthprint.errors import DataError, SettingsError

VARIANTS = [
    NearestComplexityClassifier(),
    NearestComplexityClassifier(3),
    NearestComplexityClassifier(local_scaling=2),
]


@pytest.mark.parametrize(
    ("estimator", "check"),
    [pair for variant in VARIANTS for pair in estimator_checks_generator(variant)],
    ids=lambda value: getattr(getattr(value, "func", None), "__name__", str(value)),
)
def test_passes_scikit_learns_estimator_checks(estimator, check):
    check(estimator)


def blobs(seed: int = 0, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, 4, n)
    points = rng.normal(size=(n, 3)) + 1.5 * labels[:, None]
    return points, np.array(["bowl", "cap", "food_bag", "mug"])[labels]


def distances_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(a[:, None] - b[None, :], axis=2)


@settings(deadline=None)
@given(seed=st.integers(0, 10_000))
def test_nearest_neighbour_is_scikit_learns(seed):
    points, labels = blobs(seed)
    train, test = distances_between(points[:40], points[:40]), distances_between(points[40:], points[:40])
    ours = NearestComplexityClassifier().fit(train, labels[:40])
    theirs = KNeighborsClassifier(1, metric="precomputed").fit(train, labels[:40])
    np.testing.assert_array_equal(ours.predict(test), theirs.predict(test))
    for mine, other in zip(ours.kneighbors(test, 5), theirs.kneighbors(test, 5), strict=True):
        np.testing.assert_allclose(mine, other)


def test_majority_of_k_wins_and_a_tie_goes_to_the_nearer_class():
    fitted = NearestComplexityClassifier(3).fit(np.zeros((4, 4)), ["a", "b", "b", "c"])
    assert fitted.predict([[0.1, 0.2, 0.3, 0.9]]) == ["b"]
    tied = NearestComplexityClassifier(4).fit(np.zeros((4, 4)), ["a", "b", "b", "a"])
    assert tied.predict([[0.1, 0.2, 0.3, 0.9]]) == ["b"]
    assert tied.predict([[0.1, 0.2, 0.9, 0.3]]) == ["a"]


def test_local_scaling_matches_its_definition():
    points, labels = blobs(3, 30)
    train, test = distances_between(points[:20], points[:20]), distances_between(points[20:], points[:20])
    fitted = NearestComplexityClassifier(local_scaling=4).fit(train, labels[:20])
    expected = np.empty_like(test)
    for q in range(10):
        for t in range(20):
            scale_t = np.sort(np.delete(train[t], t))[3]
            expected[q, t] = test[q, t] / np.sqrt(np.sort(test[q])[3] * scale_t)
    distances, indices = fitted.kneighbors(test, 20)
    np.testing.assert_allclose(distances, np.sort(expected, axis=1))
    np.testing.assert_array_equal(indices, np.argsort(expected, axis=1))


def test_local_scaling_survives_duplicates_at_distance_zero():
    fitted = NearestComplexityClassifier(local_scaling=1).fit(np.zeros((3, 3)), [0, 1, 1])
    distances, _ = fitted.kneighbors([[0.0, 0.5, 1.0]], 3)
    assert np.isfinite(distances).all()
    assert fitted.predict([[0.0, 0.5, 1.0]]) == [0]


def test_ranking_names_each_class_once_with_its_nearest_object():
    fitted = NearestComplexityClassifier().fit(None, ["mug", "cap", "mug", "bowl"])
    ranking = fitted.predict_with_distances([[0.5, 0.1, 0.3, 0.9], [0.2, 0.3, 0.1, 0.0]])
    assert ranking.labels.tolist() == [["cap", "mug", "bowl"], ["bowl", "mug", "cap"]]
    np.testing.assert_allclose(ranking.distances, [[0.1, 0.3, 0.9], [0.0, 0.1, 0.3]])
    assert ranking.neighbours.tolist() == [[1, 2, 3], [3, 2, 1]]
    assert not ranking.distances.flags.writeable
    assert len(ranking) == 2


def test_cross_validation_slices_both_axes_of_the_distances():
    points, labels = blobs(1, 80)
    everything = distances_between(points, points)
    scores = cross_val_score(NearestComplexityClassifier(), everything, labels, cv=4)
    reference = cross_val_score(KNeighborsClassifier(1), points, labels, cv=4)
    np.testing.assert_allclose(scores, reference)


def test_clone_keeps_the_parameters():
    copy = clone(NearestComplexityClassifier(5, local_scaling=7))
    assert (copy.n_neighbors, copy.local_scaling, copy.metric) == (5, 7, "precomputed")


@pytest.mark.parametrize(
    ("estimator", "X", "y", "error"),
    [
        (NearestComplexityClassifier(0), np.zeros((2, 2)), [0, 1], SettingsError),
        (NearestComplexityClassifier(local_scaling=-1), np.zeros((2, 2)), [0, 1], SettingsError),
        (NearestComplexityClassifier(metric="euclidean"), np.zeros((2, 2)), [0, 1], SettingsError),
        (NearestComplexityClassifier(), np.zeros((2, 3)), [0, 1], DataError),
        (NearestComplexityClassifier(), -np.ones((2, 2)), [0, 1], DataError),
        (NearestComplexityClassifier(), np.full((2, 2), np.nan), [0, 1], DataError),
        (NearestComplexityClassifier(3), np.zeros((2, 2)), [0, 1], DataError),
        (NearestComplexityClassifier(local_scaling=2), np.zeros((2, 2)), [0, 1], DataError),
        (NearestComplexityClassifier(local_scaling=1), None, [0, 1], DataError),
        (NearestComplexityClassifier(), None, [], DataError),
        (NearestComplexityClassifier(), np.zeros((2, 2)), None, DataError),
    ],
)
def test_malformed_input_to_fit_raises(estimator, X, y, error):
    with pytest.raises(error):
        estimator.fit(X, y)


def test_malformed_queries_raise():
    with pytest.raises(NotFittedError):
        NearestComplexityClassifier().predict([[1.0]])
    fitted = NearestComplexityClassifier().fit(None, ["a", "b"])
    with pytest.raises(DataError, match="expecting 2 features"):
        fitted.predict([[1.0, 2.0, 3.0]])
    with pytest.raises(DataError, match=">= 0"):
        fitted.predict([[1.0, -2.0]])
    with pytest.raises(SettingsError):
        fitted.kneighbors([[1.0, 2.0]], 3)
