"""Probabilities of matches: monotone, summing to one, and calibrated where the truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from depthprint.errors import DataError, SettingsError
from depthprint.loop_probability import match_probabilities, same_place_odds


def test_odds_of_two_normal_distributions_are_their_likelihood_ratio():
    rng = np.random.default_rng(0)
    same, different = rng.normal(0.3, 0.1, 4000), rng.normal(0.5, 0.1, 4000)
    asked = np.linspace(0.2, 0.6, 9)
    true_log = ((asked - 0.5) ** 2 - (asked - 0.3) ** 2) / (2 * 0.1**2)
    np.testing.assert_allclose(np.log(same_place_odds(asked, same, different)), true_log, atol=0.4)


@given(
    same=st.lists(st.floats(0, 1), min_size=2, max_size=20),
    different=st.lists(st.floats(0, 1), min_size=2, max_size=20),
)
def test_odds_are_finite_and_never_grow_with_the_distance(same, different):
    odds = same_place_odds(np.linspace(-1, 2, 20), same, different)
    assert np.isfinite(odds).all()
    assert (odds > 0).all()
    assert (np.diff(odds) <= 0).all()


@given(odds=st.lists(st.floats(0, 1e6), max_size=8), rate=st.floats(0.01, 0.99), more=st.integers(1, 1000))
def test_probabilities_sum_to_one_with_a_new_place_among_them(odds, rate, more):
    shares = match_probabilities(odds, len(odds) + more, rate)
    assert len(shares) == len(odds) + 1
    assert shares.sum() == pytest.approx(1.0)
    assert (shares >= 0).all()
    assert shares[-1] > 0


def test_probabilities_are_calibrated_where_the_model_holds():
    rng = np.random.default_rng(1)
    candidates, told, true = 50, [], []
    same, different = rng.normal(0.25, 0.08, 500), rng.normal(0.6, 0.08, 500)
    for _ in range(1500):
        distances = rng.normal(0.6, 0.08, candidates)
        returns = rng.random() < 0.3
        if returns:
            distances[7] = rng.normal(0.25, 0.08)
        best = np.argsort(distances)[:5]
        shares = match_probabilities(same_place_odds(distances[best], same, different), candidates, 0.3)
        told.append(shares[0])
        true.append(returns and best[0] == 7)
    told, true = np.array(told), np.array(true)
    assert np.mean((told - true) ** 2) < 0.05
    assert true[told > 0.9].mean() > 0.85
    assert true[told < 0.1].mean() < 0.1


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda: same_place_odds([0.1], [0.1], [0.2, 0.3]), DataError),
        (lambda: same_place_odds([np.nan], [0.1, 0.2], [0.2, 0.3]), DataError),
        (lambda: match_probabilities([1.0], 5, 0.0), SettingsError),
        (lambda: match_probabilities([1.0, 1.0], 1), DataError),
    ],
)
def test_what_cannot_be_told_raises(call, error):
    with pytest.raises(error):
        call()
