"""The threshold of a drive whose truth is unknown."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from depthprint.errors import DataError, SettingsError
from depthprint.runs.threshold import background_threshold


def test_different_places_undercut_it_as_seldom_as_asked() -> None:
    rng = np.random.default_rng(0)
    threshold = background_threshold(rng.normal(0.8, 0.05, 20_000), 100, false_per_query=0.1)
    queries = rng.normal(0.8, 0.05, (5_000, 100)).min(axis=1)
    assert threshold is not None
    assert (queries <= threshold).mean() == pytest.approx(0.1, abs=0.03)


def test_a_few_returns_among_the_pairs_hardly_move_it() -> None:
    rng = np.random.default_rng(1)
    different = rng.normal(0.8, 0.05, 10_000)
    returns = rng.uniform(0.1, 0.3, 300)
    alone = background_threshold(different, 200)
    mixed = background_threshold(np.concatenate([different, returns]), 200)
    assert alone is not None
    assert mixed == pytest.approx(alone, abs=0.03)
    assert (returns <= alone).all()


def test_distances_that_do_not_spread_give_none() -> None:
    assert background_threshold([0.7] * 50, 10) is None


@given(st.lists(st.floats(0, 1), min_size=2, max_size=60), st.floats(1, 1e4), st.floats(0.01, 0.4))
def test_it_is_a_distance_below_the_median_and_falls_with_more_candidates(
    distances: list[float], candidates: float, chance: float
) -> None:
    threshold = background_threshold(distances, candidates, false_per_query=chance)
    if threshold is not None:
        assert 0 <= threshold <= np.median(distances)
        more = background_threshold(distances, 2 * candidates, false_per_query=chance)
        assert more is not None
        assert more <= threshold


def test_wrong_input_is_refused() -> None:
    for distances in ([], [0.1], [0.1, float("nan")], [[0.1, 0.2]]):
        with pytest.raises(DataError, match="two finite distances"):
            background_threshold(distances, 10)
    for candidates, chance in ((0, 0.1), (10, 0.0), (10, 1.0)):
        with pytest.raises(SettingsError, match="chance"):
            background_threshold([0.1, 0.2], candidates, false_per_query=chance)
