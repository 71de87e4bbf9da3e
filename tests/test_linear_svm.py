"""The linear machine against scikit-learn's, which seeks the same optimum."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.svm import LinearSVC

from depthprint.baselines.linear_svm import GramSvm, LinearSvm, gram_matrix
from depthprint.errors import ConvergenceError, DataError, SettingsError


def samples(n=90, dims=150, classes=4, seed=0):
    generator = np.random.default_rng(seed)
    labels = np.arange(n) % classes
    centres = generator.normal(size=(classes, dims))
    return (0.3 * centres[labels] + generator.normal(size=(n, dims))).astype(np.float32), labels


@pytest.mark.parametrize("C", [0.001, 0.1, 10.0])
@pytest.mark.parametrize("dims", [20, 150])
def test_margins_are_those_of_liblinear(C, dims):
    x, y = samples(dims=dims)
    known, asked = x[:60], x[60:]
    theirs = LinearSVC(C=C, fit_intercept=False, tol=1e-7, max_iter=200_000, random_state=0).fit(
        known, y[:60]
    )
    ours = LinearSvm(C, tolerance=1e-4, max_passes=20_000).fit(known, y[:60])
    np.testing.assert_allclose(ours.decision_function(asked), theirs.decision_function(asked), atol=5e-3)
    assert (ours.predict(asked) == theirs.predict(asked)).mean() > 0.95


def test_two_classes_have_one_margin_as_scikit_learn_has_it():
    x, y = samples(classes=2)
    names = np.array(["mug", "vase"])[y]
    machine = LinearSvm(1.0).fit(x, names)
    theirs = LinearSVC(C=1.0, fit_intercept=False, tol=1e-7, max_iter=200_000).fit(x, names)
    assert machine.decision_function(x).shape == (len(x),)
    np.testing.assert_allclose(machine.decision_function(x), theirs.decision_function(x), atol=0.03)
    assert (machine.predict(x) == names).all()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(5, 150), C=st.sampled_from([0.01, 1.0, 100.0]))
def test_solutions_meet_the_conditions_of_the_optimum(seed, n, C):
    x, y = samples(n=n, dims=200, classes=3, seed=seed)
    gram = x @ x.T
    machine = GramSvm(C).fit(gram, y)
    signs = np.where(y[:, None] == machine.labels, 1.0, -1.0)
    alpha = signs * machine.multipliers
    assert (alpha >= 0).all()
    # Each multiplier is 2 C times its sample's shortfall from the margin.
    shortfall = np.maximum(1.0 - signs * machine.scores(gram), 0.0)
    np.testing.assert_allclose(alpha / (2 * C), shortfall, atol=0.03)


def test_the_same_seed_gives_the_same_bits():
    x, y = samples()
    first, second = (GramSvm(10.0, seed=4).fit(x @ x.T, y).multipliers for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("n", [1, 512, 700])
def test_inner_products_of_all_pairs(n):
    x, _ = samples(n=n, dims=7)
    gram = gram_matrix(x)
    np.testing.assert_allclose(gram, x.astype(np.float64) @ x.T.astype(np.float64), atol=1e-4)
    np.testing.assert_allclose(gram, gram.T, rtol=1e-5, atol=1e-5)


def test_what_cannot_be_is_refused():
    x, y = samples(n=12)
    with pytest.raises(SettingsError, match="C: expected a positive number"):
        GramSvm(0.0)
    with pytest.raises(DataError, match=r"expected a matrix \(12, 12\)"):
        GramSvm().fit(x, y)
    spoiled = x @ x.T
    spoiled[3, 4] = np.nan
    with pytest.raises(DataError, match="finite"):
        GramSvm().fit(spoiled, y)
    with pytest.raises(DataError, match="two classes"):
        GramSvm().fit(x @ x.T, np.zeros(12))
    with pytest.raises(DataError, match=r"inner products \(m, 12\)"):
        GramSvm().fit(x @ x.T, y).scores(np.zeros((2, 11), dtype=np.float32))


def test_a_machine_that_has_not_converged_says_so():
    x, y = samples(n=90, dims=20)
    with pytest.raises(ConvergenceError, match="after 2 passes"):
        GramSvm(1000.0, tolerance=1e-6, max_passes=2).fit(x @ x.T, y)


def test_estimator_can_be_cloned():
    copy = clone(LinearSvm(3.0, tolerance=0.1, random_state=7))
    assert (copy.C, copy.tolerance, copy.random_state) == (3.0, 0.1, 7)
