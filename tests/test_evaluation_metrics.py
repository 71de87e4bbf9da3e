from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from sklearn.metrics import average_precision_score

from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.metrics import (
    QueryOutcomes,
    bootstrap_intervals,
    loop_metrics,
    precision_recall,
)

NAN = float("nan")


def outcomes(rows: list[tuple[float, int, bool]]) -> QueryOutcomes:
    scores, values, positive = zip(*rows, strict=True)
    return QueryOutcomes(np.array(scores), np.array(values), np.array(positive))


def test_hand_worked_example():
    # surest first: hit, hit, false, hit; one query to be found names a wrong place, one names an ignored one
    queries = outcomes(
        [(0.9, 1, True), (0.8, 1, True), (0.7, -1, False), (0.6, 1, True), (0.5, -1, True), (0.4, 0, True)]
    )
    curve = precision_recall(queries)
    assert_allclose(curve.precision, [1, 1, 2 / 3, 3 / 4, 3 / 5, 3 / 5])
    assert_allclose(curve.recall, np.array([1, 2, 2, 3, 3, 3]) / 5)
    metrics = loop_metrics(queries)
    assert metrics.recall_at_100_precision == pytest.approx(2 / 5)
    assert metrics.average_precision == pytest.approx(1 / 5 + 1 / 5 + 3 / 4 / 5)
    assert metrics.f1_max == pytest.approx(2 * 0.75 * 0.6 / (0.75 + 0.6))
    assert metrics.extended_precision == pytest.approx((1 + 2 / 5) / 2)
    assert metrics.recall_at_1 == pytest.approx(3 / 5)
    assert metrics.threshold_at_100_precision == 0.8


def test_wrong_match_of_a_query_with_a_loop_is_false_positive_and_miss():
    curve = precision_recall(outcomes([(2.0, -1, True), (1.0, 1, True)]))
    assert curve.false_positives.tolist() == [1, 1]
    assert_allclose(curve.recall, [0, 0.5])


def test_ignored_match_counts_neither_way_but_its_loop_stays_to_be_found():
    metrics = loop_metrics(outcomes([(3.0, 0, True), (2.0, 0, False), (1.0, 1, True)]))
    assert metrics.recall_at_100_precision == 0.5
    assert metrics.average_precision == 0.5
    assert metrics.recall_at_1 == 0.5


def test_ties_are_passed_together_whatever_their_order():
    hit_first = [(1.0, 1, True), (1.0, -1, False), (0.5, 1, True)]
    for rows in (hit_first, [hit_first[1], hit_first[0], hit_first[2]]):
        curve = precision_recall(outcomes(rows))
        assert_allclose(curve.thresholds, [1.0, 0.5])
        assert_allclose(curve.precision, [1 / 2, 2 / 3])
        metrics = loop_metrics(outcomes(rows))
        assert metrics.recall_at_100_precision == 0.0
        assert metrics.average_precision == pytest.approx(0.5 / 2 + (2 / 3) / 2)
        assert np.isnan(metrics.threshold_at_100_precision)


def test_false_positive_on_top_leaves_no_recall_at_full_precision():
    metrics = loop_metrics(outcomes([(2.0, -1, False), (1.0, 1, True)]))
    assert metrics.recall_at_100_precision == 0.0
    assert metrics.extended_precision == pytest.approx(0.25)


def test_query_without_a_match_is_a_miss_and_never_detected():
    curve = precision_recall(outcomes([(1.0, 1, True), (NAN, 0, True)]))
    assert_allclose(curve.thresholds, [1.0])
    assert_allclose(curve.recall, [0.5])


def test_precision_is_unknown_while_only_ignored_matches_are_detected():
    curve = precision_recall(outcomes([(2.0, 0, False), (1.0, 1, True)]))
    assert np.isnan(curve.precision[0])
    assert curve.precision[1] == 1.0


def test_without_loops_there_are_no_figures():
    metrics = loop_metrics(outcomes([(1.0, -1, False), (0.5, 0, False)]))
    assert np.isnan([metrics.average_precision, metrics.recall_at_100_precision, metrics.recall_at_1]).all()


def test_nothing_found_is_zero():
    metrics = loop_metrics(outcomes([(1.0, -1, True), (NAN, 0, True)]))
    assert metrics.average_precision == metrics.f1_max == metrics.recall_at_1 == 0.0


@st.composite
def random_queries(draw):
    n = draw(st.integers(1, 40))
    scores = draw(st.lists(st.integers(0, 12), min_size=n, max_size=n))
    values = draw(st.lists(st.sampled_from([-1, 0, 1]), min_size=n, max_size=n))
    missed = draw(st.lists(st.booleans(), min_size=n, max_size=n))
    positive = [v == 1 or m for v, m in zip(values, missed, strict=True)]
    return QueryOutcomes(np.array(scores, dtype=float), np.array(values), np.array(positive))


@settings(deadline=None)
@given(random_queries())
def test_average_precision_is_scikit_learns_over_all_loops(queries):
    counted = queries.outcomes != 0
    hits = queries.outcomes[counted] == 1
    if not hits.any():
        return
    theirs = average_precision_score(hits, queries.scores[counted]) * hits.sum() / queries.has_positive.sum()
    assert loop_metrics(queries).average_precision == pytest.approx(theirs)


@settings(deadline=None)
@given(random_queries(), st.integers(0, 2**31))
def test_figures_do_not_depend_on_the_order_of_queries_or_the_scale_of_scores(queries, seed):
    order = np.random.default_rng(seed).permutation(len(queries))
    shuffled = queries.take(order)
    rescaled = QueryOutcomes(3 * shuffled.scores - 7, shuffled.outcomes, shuffled.has_positive)
    ours, theirs = loop_metrics(queries), loop_metrics(rescaled)
    for name in (
        "recall_at_100_precision",
        "average_precision",
        "f1_max",
        "extended_precision",
        "recall_at_1",
    ):
        assert getattr(ours, name) == pytest.approx(getattr(theirs, name), nan_ok=True)


@settings(deadline=None)
@given(random_queries())
def test_sweep_equals_counting_at_every_threshold(queries):
    curve = precision_recall(queries)
    for k, threshold in enumerate(curve.thresholds):
        detected = queries.scores >= threshold
        assert curve.true_positives[k] == (detected & (queries.outcomes == 1)).sum()
        assert curve.false_positives[k] == (detected & (queries.outcomes == -1)).sum()


def test_intervals_hold_the_figure_and_repeat_for_a_seed():
    generator = np.random.default_rng(5)
    positive = generator.random(600) < 0.5
    hit = positive & (generator.random(600) < 0.8)
    scores = generator.random(600) + hit
    queries = QueryOutcomes(scores, np.where(hit, 1, -1), positive)
    intervals = bootstrap_intervals(queries, 3, resamples=200)
    low, high = intervals["average_precision"]
    assert low < loop_metrics(queries).average_precision < high
    assert intervals == bootstrap_intervals(queries, 3, resamples=200)
    assert intervals != bootstrap_intervals(queries, 4, resamples=200)


def test_blocks_widen_the_interval_of_queries_that_come_in_runs():
    hit = np.repeat(np.random.default_rng(0).random(20) < 0.5, 50)
    queries = QueryOutcomes(hit * 1.0, np.where(hit, 1, -1), np.ones(1000, dtype=bool))

    def width(block: int) -> float:
        low, high = bootstrap_intervals(queries, 0, resamples=200, block=block)["recall_at_1"]
        return high - low

    assert width(50) > 3 * width(1)


def test_every_block_of_full_length_gives_the_figure_itself():
    # blocks as long as the sequence only rotate it, and order does not count
    queries = outcomes([(0.9, 1, True), (0.8, -1, True), (0.8, 1, True), (NAN, 0, True), (0.2, 0, False)])
    metrics = loop_metrics(queries)
    for name, (low, high) in bootstrap_intervals(queries, 0, resamples=20, block=5).items():
        assert low == high == pytest.approx(getattr(metrics, name))


def test_intervals_are_unknown_without_loops():
    low, high = bootstrap_intervals(outcomes([(1.0, -1, False)]), 0, resamples=5)["f1_max"]
    assert np.isnan([low, high]).all()


@pytest.mark.parametrize(
    ("scores", "values", "positive"),
    [
        ([1.0], [1, 1], [True, True]),
        ([np.inf], [1], [True]),
        ([1.0], [2], [True]),
        ([1.0], [1], [False]),
        ([NAN], [-1], [False]),
    ],
)
def test_impossible_outcomes_are_refused(scores, values, positive):
    with pytest.raises(DataError, match="QueryOutcomes"):
        QueryOutcomes(np.array(scores), np.array(values), np.array(positive))


def test_impossible_bootstrap_is_refused():
    with pytest.raises(SettingsError, match="level"):
        bootstrap_intervals(outcomes([(1.0, 1, True)]), 0, level=1.5)
