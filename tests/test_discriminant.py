"""Kernel discriminant and the features of distances, against slow references and scikit-learn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.svm import LinearSVC

from depthprint.baselines.linear_svm import GramSvm, linear_directions
from depthprint.errors import DataError, ModelError, SettingsError
from depthprint.objects.discriminant import KernelDiscriminant, discriminant_directions
from depthprint.objects.distances import MirroredDistances
from depthprint.objects.fused_recogniser import (
    MACHINE_C,
    FusedRecogniser,
    ViewComparison,
    fused_comparison,
    nearest_weights,
    standardised,
)
from depthprint.objects.kernels import DistanceFeatures, unit_rows


def blobs(seed, classes=4, each=12, d=6, spread=0.6):
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(classes, d))
    labels = np.repeat(np.arange(classes), each)
    return means[labels] + spread * rng.normal(size=(len(labels), d)), labels


def primal_scores(x, labels, queries, shrinkage):
    classes = np.unique(labels)
    means = np.stack([x[labels == c].mean(0) for c in classes])
    centred = x - means[np.searchsorted(classes, labels)]
    covariance = centred.T @ centred / len(x)
    ridge = shrinkage * np.trace(covariance) / len(x)
    solved = np.linalg.solve(covariance + ridge * np.eye(x.shape[1]), means.T)
    return queries @ solved - 0.5 * (means * solved.T).sum(1)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 1000), st.floats(0.01, 10))
def test_scores_are_those_of_the_discriminant_in_feature_space(seed, shrinkage):
    x, labels = blobs(seed)
    queries = blobs(seed + 1)[0][:7]
    machine = KernelDiscriminant(shrinkage).fit(x @ x.T, labels)
    expected = primal_scores(x, labels, queries, shrinkage)
    found = machine.scores(queries @ x.T)
    assert np.allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_with_little_shrinkage_it_is_sklearn_s_discriminant():
    x, labels = blobs(3, each=40)
    queries = blobs(4, each=40)[0]
    ours = KernelDiscriminant(1e-6).fit(x @ x.T, labels).scores(queries @ x.T).argmax(1)
    theirs = LinearDiscriminantAnalysis(solver="lsqr").fit(x, labels).predict(queries)
    assert np.mean(ours == theirs) > 0.99


def test_one_view_a_class_ranks_by_the_nearest_mean():
    x = np.eye(3)
    machine = KernelDiscriminant().fit(x @ x.T, [5, 6, 7])
    assert machine.scores(np.array([[0.1, 0.9, 0.2]])).argmax() == 1


@pytest.mark.parametrize(
    ("kernel", "labels", "message"),
    [
        (np.eye(3), [0, 1], "got .3, 3."),
        (np.full((2, 2), np.nan), [0, 1], "finite"),
        (np.eye(2), [1, 1], "two classes"),
        (np.array([[0.0, 5.0, 0], [5.0, 0.0, 0], [0, 0, 1]]), [0, 0, 1], "semi-definite"),
    ],
)
def test_kernels_that_are_none_are_refused(kernel, labels, message):
    with pytest.raises(DataError, match=message):
        KernelDiscriminant().fit(kernel, labels)


def test_misuse_is_refused():
    with pytest.raises(SettingsError, match="shrinkage"):
        KernelDiscriminant(0.0)
    with pytest.raises(ModelError, match="not fitted"):
        KernelDiscriminant().scores(np.eye(2))
    with pytest.raises(DataError, match=r"\(m, 2\)"):
        KernelDiscriminant().fit(np.eye(2), [0, 1]).scores(np.eye(3))
    with pytest.raises(ModelError, match="not fitted"):
        _ = FusedRecogniser().labels
    fused = FusedRecogniser().fit(ViewComparison(np.eye(2)), [0, 1])
    with pytest.raises(DataError, match="0 matrices"):
        fused.scores(ViewComparison(np.eye(2), (np.eye(2),)))


def euclidean(x, y):
    return np.linalg.norm(x[:, None] - y[None], axis=2)


def test_features_of_all_distances_give_the_kernel_of_a_metric_that_embeds():
    x, _ = blobs(0)
    distances = euclidean(x, x)
    features = DistanceFeatures(MirroredDistances(distances))
    rows = features.of(MirroredDistances(distances))
    kernel = np.exp(-(distances**2) / np.median(distances[~np.eye(len(x), dtype=bool)] ** 2))
    # What is left out is a millionth of the largest eigenvalue each.
    assert np.abs(rows @ rows.T - kernel).max() < 5e-3


def test_features_are_unit_and_positive_semi_definite_for_distances_that_embed_nowhere():
    rng = np.random.default_rng(0)
    distances = rng.uniform(0.2, 1.0, (20, 20))
    distances = (distances + distances.T) / 2
    np.fill_diagonal(distances, 0)
    mirrored = np.minimum(distances + 0.1, 1)
    pair = MirroredDistances(distances, mirrored)
    rows = DistanceFeatures(pair).of(pair)
    assert np.allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-5)
    assert np.linalg.eigvalsh(rows @ rows.T).min() > -1e-4
    with pytest.raises(DataError, match="two views or more"):
        DistanceFeatures(MirroredDistances(np.zeros((1, 1))))


def test_fusion_is_better_than_its_parts_where_each_errs():
    x, labels = blobs(7, classes=5, each=20, spread=1.0)
    y, truth = blobs(7, classes=5, each=20, spread=1.0)[0] + 0.5, labels
    stored = ViewComparison(x @ x.T, (euclidean(x, x),))
    asked = ViewComparison(y @ x.T, (euclidean(y, x),))
    fused = FusedRecogniser(local_scaling=3).fit(stored, labels)
    right = np.mean(fused.labels[fused.scores(asked).argmax(1)] == truth)
    machine = KernelDiscriminant().fit(stored.kernel, labels)
    alone = np.mean(machine.scores(asked.kernel).argmax(1) == truth)
    assert right >= alone - 0.05
    assert right > 0.5


def test_fused_kernels_are_weighted_means_and_distances_follow_each_other():
    x, _ = blobs(5)
    first = ViewComparison(x @ x.T, (euclidean(x, x),))
    second = ViewComparison(np.eye(len(x)), (), np.eye(2 * len(x)))
    fused = fused_comparison([first, second], [3.0, 1.0])
    np.testing.assert_allclose(fused.kernel, (3 * x @ x.T + np.eye(len(x))) / 4)
    assert len(fused.distances) == 1
    np.testing.assert_array_equal(fused.machine_kernel, second.machine_kernel)
    third = ViewComparison(np.eye(len(x)), (), np.ones((2 * len(x), 2 * len(x))))
    of_both = fused_comparison([second, third], [1.0, 3.0]).machine_kernel
    np.testing.assert_allclose(of_both, (np.eye(2 * len(x)) + 1) / 2)


def test_nearest_views_count_by_the_weights_of_their_parts():
    assert nearest_weights(["codes", "complexities", "surfaces", "pairs"]) == (0.5, 0.5, 1.0)
    assert nearest_weights(["complexities"]) == ()
    x, labels = blobs(8)
    y, _ = blobs(9)
    near, far = euclidean(x, x), euclidean(x[:, :1], x[:, :1])
    stored = ViewComparison(x @ x.T, (near, far))
    asked = ViewComparison(y @ x.T, (euclidean(y, x), euclidean(y[:, :1], x[:, :1])))

    def scores(*weights):
        return FusedRecogniser(nearest_weights=weights).fit(stored, labels).scores(asked)

    without, first, second = scores(0.0, 0.0), scores(1.0, 0.0), scores(0.0, 1.0)
    np.testing.assert_allclose(scores(0.5, 2.0) - without, 0.5 * (first - without) + 2 * (second - without))
    np.testing.assert_allclose(FusedRecogniser().fit(stored, labels).scores(asked), scores(1.0, 1.0))


def test_the_machine_adds_its_standardised_margins():
    x, labels = (unit_rows(blobs(6, d=200)[0]).astype(np.float64), blobs(6, d=200)[1])
    y = unit_rows(blobs(7, d=200)[0]).astype(np.float64)
    known = np.concatenate([x, x[:, ::-1]])
    stored = ViewComparison(x @ x.T, (), known @ known.T)
    asked = ViewComparison(y @ x.T, (), y @ known.T)
    together = FusedRecogniser().fit(stored, labels)
    plain = FusedRecogniser().fit(ViewComparison(stored.kernel), labels)
    machine = LinearSVC(C=MACHINE_C, fit_intercept=False, tol=1e-6, max_iter=100_000)
    machine.fit(known, np.tile(labels, 2))
    expected = plain.scores(ViewComparison(asked.kernel)) + standardised(machine.decision_function(y))
    np.testing.assert_allclose(together.scores(asked), expected, atol=0.05)
    with pytest.raises(DataError, match="machine kernel"):
        together.scores(ViewComparison(asked.kernel))


def test_directions_of_vectors_give_the_scores_of_their_kernel():
    x, labels = blobs(8)
    asked, _ = blobs(9)
    kernel = KernelDiscriminant(0.3).fit(x @ x.T, labels)
    classes, numbers = np.unique(labels, return_inverse=True)
    directions, offsets = discriminant_directions(x, numbers, 0.3)
    assert directions.shape == (x.shape[1], len(classes))
    np.testing.assert_allclose(asked @ directions + offsets, kernel.scores(asked @ x.T), rtol=1e-6, atol=1e-6)


def test_the_machine_of_many_vectors_is_at_least_as_near_its_optimum_as_that_of_their_products():
    for n_classes in (2, 4):
        x, labels = blobs(10)
        keep = labels < n_classes
        x, labels = unit_rows(x[keep]).astype(np.float64), labels[keep]
        signs = np.where(labels[:, None] == np.arange(n_classes), 1, -1)

        def loss(directions, x=x, signs=signs):
            errors = np.maximum(1 - signs * (x @ directions), 0)
            return (directions**2).sum(axis=0) / 2 + 40 * (errors**2).sum(axis=0)

        pairs = GramSvm(40.0).fit((x @ x.T).astype(np.float32), labels)
        found = linear_directions(x, labels, 40.0)
        assert found.shape == (x.shape[1], n_classes)
        assert (loss(found) <= 1.002 * loss(x.T @ pairs.multipliers)).all()
