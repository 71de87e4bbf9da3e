"""The threshold of a drive whose truth is unknown."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from depthprint.errors import DataError, SettingsError
from depthprint.runs.threshold import agreement, agreement_threshold


def test_matches_that_run_along_agree_in_both_directions() -> None:
    assert agreement([10, 11, 12, 300, 42, 41, 40], window=2).tolist() == [True] * 3 + [False] + [True] * 3


def test_the_threshold_ends_where_chance_resemblances_begin() -> None:
    rng = np.random.default_rng(0)
    matches = np.concatenate([np.arange(100, 200), rng.integers(0, 10_000, 100)])
    distances = np.concatenate([rng.uniform(0.1, 0.4, 100), rng.uniform(0.6, 0.9, 100)])
    threshold = agreement_threshold(matches, distances)
    assert threshold is not None
    assert distances[:100].max() <= threshold < np.sort(distances[100:])[10]


def test_a_drive_without_returns_gets_no_threshold() -> None:
    matches = np.arange(50)[::-1] * 100
    assert agreement_threshold(matches, np.linspace(0.5, 0.9, 50)) is None


def test_equal_distances_stand_or_fall_together() -> None:
    matches = [10, 11, 12, 900, 400, 700]
    assert agreement_threshold(matches, [0.2, 0.2, 0.2, 0.5, 0.5, 0.5], share=0.9) == 0.2
    assert agreement_threshold(matches, [0.5] * 6, share=0.9) is None


def test_no_match_gives_no_threshold() -> None:
    assert agreement_threshold([], []) is None


@given(
    st.lists(st.tuples(st.integers(0, 50), st.floats(0, 1)), max_size=60),
    st.floats(0.05, 1.0),
)
def test_the_asked_share_agrees_below_the_threshold_and_no_larger_one_has_it(
    answers: list[tuple[int, float]], share: float
) -> None:
    matches = np.array([m for m, _ in answers], dtype=np.int64)
    distances = np.array([d for _, d in answers])
    agrees = agreement(matches)
    threshold = agreement_threshold(matches, distances, share=share)
    if threshold is not None:
        assert agrees[distances <= threshold].mean() >= share
    for larger in distances[distances > (-1 if threshold is None else threshold)]:
        assert agrees[distances <= larger].mean() < share


def test_wrong_input_is_refused() -> None:
    with pytest.raises(DataError, match="finite"):
        agreement_threshold([1, 2], [0.1, float("nan")])
    with pytest.raises(DataError, match="one finite distance per match"):
        agreement_threshold([1, 2], [0.1])
    with pytest.raises(SettingsError, match="share"):
        agreement_threshold([1, 2], [0.1, 0.2], share=0.0)
    with pytest.raises(DataError, match=r"matches \(q,\)"):
        agreement([[1, 2]])
