"""Query-wise precision and recall, over the sorted scores themselves: pure functions of arrays.

A query names its best match and a score; its outcome is 1 where the match is a positive one, -1 where it is a
negative one, 0 where the truth says 'ignore'. At a threshold, every query whose score reaches it is a
detection. An ignored detection counts neither as true nor as false; its query, where it has a positive
candidate, stays among those to be found. A wrong match for a query that has a positive candidate is a false
positive and a miss.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = [
    "Interval",
    "LoopMetrics",
    "PrecisionRecall",
    "QueryOutcomes",
    "bootstrap_intervals",
    "loop_metrics",
    "precision_recall",
]

FloatArray = npt.NDArray[np.float64]
Interval = tuple[float, float]


@dataclass(frozen=True)
class QueryOutcomes:
    """What became of each query, in time order.

    scores: (q,) float64, larger = surer; NaN where the query made no match, which is never a detection.
    outcomes: (q,) int8: 1 positive, 0 ignore, -1 negative match.
    has_positive: (q,) bool, whether the query has a positive candidate at all.
    """

    scores: FloatArray
    outcomes: npt.NDArray[np.int8]
    has_positive: npt.NDArray[np.bool_]

    def __post_init__(self) -> None:
        scores = np.array(self.scores, dtype=np.float64)
        outcomes = np.array(self.outcomes)
        has_positive = np.array(self.has_positive, dtype=bool)
        if scores.ndim != 1 or not scores.shape == outcomes.shape == has_positive.shape:
            raise DataError(
                "QueryOutcomes: expected three arrays of one length, got shapes "
                f"{scores.shape}, {outcomes.shape} and {has_positive.shape}"
            )
        if np.isinf(scores).any():
            raise DataError(
                f"QueryOutcomes: the score of query {int(np.argmax(np.isinf(scores)))} is infinite"
            )
        if not np.isin(outcomes, (-1, 0, 1)).all():
            raise DataError("QueryOutcomes: expected the outcomes 1, 0 and -1 only")
        if (outcomes[np.isnan(scores)] != 0).any():
            raise DataError("QueryOutcomes: expected the outcome 0 of queries without a match (score NaN)")
        impossible = (outcomes == 1) & ~has_positive
        if impossible.any():
            raise DataError(
                f"QueryOutcomes: query {int(np.argmax(impossible))} has a positive match, "
                "but no positive candidate"
            )
        for name, array in (
            ("scores", scores),
            ("outcomes", outcomes.astype(np.int8)),
            ("has_positive", has_positive),
        ):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.scores)

    def take(self, index: npt.NDArray[np.intp]) -> QueryOutcomes:
        """Return the outcomes of some queries, repeats allowed."""
        return QueryOutcomes(self.scores[index], self.outcomes[index], self.has_positive[index])


@dataclass(frozen=True)
class PrecisionRecall:
    """Precision and recall at each distinct score, surest first; ties are passed together.

    thresholds, precision, recall: (t,) float64. ``precision`` is NaN where nothing but ignored matches is
    detected yet. ``recall`` is NaN throughout where no query has a positive candidate.
    true_positives, false_positives: (t,) int64.
    """

    thresholds: FloatArray
    precision: FloatArray
    recall: FloatArray
    true_positives: npt.NDArray[np.int64]
    false_positives: npt.NDArray[np.int64]


@dataclass(frozen=True)
class LoopMetrics:
    """One method's figures; all NaN where no query has a positive candidate.

    recall_at_100_precision: largest recall before the first false positive.
    average_precision: sum of precision times the step in recall.
    f1_max: largest harmonic mean of precision and recall.
    extended_precision: mean of recall_at_100_precision and the precision at the smallest recall above zero.
    recall_at_1: share of the queries to be found whose best match is positive, whatever its score.
    threshold_at_100_precision: score down to which every counted detection is true, NaN where there is none.
    """

    recall_at_100_precision: float
    average_precision: float
    f1_max: float
    extended_precision: float
    recall_at_1: float
    threshold_at_100_precision: float


def precision_recall(queries: QueryOutcomes) -> PrecisionRecall:
    """Sweep the threshold over the distinct scores, from the surest down."""
    order, last_of_tie = _sorted_ties(queries.scores)
    outcomes = queries.outcomes[order]
    true_positives = np.cumsum(outcomes == 1)[last_of_tie].astype(np.int64)
    false_positives = np.cumsum(outcomes == -1)[last_of_tie].astype(np.int64)
    counted = true_positives + false_positives
    to_find = int(queries.has_positive.sum())
    precision = np.divide(true_positives, counted, out=np.full(len(counted), np.nan), where=counted > 0)
    recall = true_positives / to_find if to_find else np.full(len(counted), np.nan)
    return PrecisionRecall(
        queries.scores[order][last_of_tie], precision, recall, true_positives, false_positives
    )


def loop_metrics(queries: QueryOutcomes) -> LoopMetrics:
    """Compute every figure of the query-wise protocol.

    Average precision follows the step form of the sum (as scikit-learn's), over recall among the queries that
    can be found. Extended precision: Ferrarini et al., "Exploring Performance Bounds of Visual Place
    Recognition Using Extended Precision", RA-L 2020.
    """
    curve = precision_recall(queries)
    to_find = int(queries.has_positive.sum())
    recall_at_100, ap, f1, ep, recall_at_1 = _figures(curve.true_positives, curve.false_positives, to_find)
    clean = (curve.true_positives > 0) & (curve.false_positives == 0)
    threshold = float(curve.thresholds[clean].min()) if clean.any() else float("nan")
    return LoopMetrics(recall_at_100, ap, f1, ep, recall_at_1, threshold)


def bootstrap_intervals(
    queries: QueryOutcomes,
    seed: int,
    *,
    resamples: int = 1000,
    block: int = 50,
    level: float = 0.95,
) -> dict[str, Interval]:
    """Return percentile intervals of the figures of ``loop_metrics``, over blocks of neighbouring queries.

    Neighbouring queries see nearly the same, so whole runs of ``block`` queries are drawn, with replacement
    and wrapping around the end (circular block bootstrap, Politis & Romano 1992). Draws without any positive
    query are left out; where more than half are, the interval is (NaN, NaN).
    """
    if resamples < 1 or block < 1 or not 0 < level < 1:
        raise SettingsError(
            "bootstrap_intervals: expected resamples >= 1, block >= 1 and 0 < level < 1, got "
            f"{resamples}, {block}, {level}"
        )
    n = len(queries)
    names = [
        "recall_at_100_precision",
        "average_precision",
        "f1_max",
        "extended_precision",
        "recall_at_1",
    ]
    nowhere = (float("nan"), float("nan"))
    if n == 0 or not queries.has_positive.any():
        return dict.fromkeys(names, nowhere)
    block = min(block, n)
    generator = np.random.default_rng(seed)
    order, last_of_tie = _sorted_ties(queries.scores)
    hit, wrong = queries.outcomes[order] == 1, queries.outcomes[order] == -1
    draws = []
    for _ in range(resamples):
        starts = generator.integers(0, n, size=-(-n // block))
        times_drawn = np.bincount((starts[:, None] + np.arange(block)).ravel()[:n] % n, minlength=n)
        to_find = int(times_drawn[queries.has_positive].sum())
        if to_find:
            in_order = times_drawn[order]
            true_positives = np.cumsum(in_order * hit)[last_of_tie]
            false_positives = np.cumsum(in_order * wrong)[last_of_tie]
            draws.append(_figures(true_positives, false_positives, to_find))
    if len(draws) <= resamples / 2:
        return dict.fromkeys(names, nowhere)
    tail = 50 * (1 - level)
    low, high = np.percentile(np.array(draws), [tail, 100 - tail], axis=0)
    return {name: (float(a), float(b)) for name, a, b in zip(names, low, high, strict=True)}


def _sorted_ties(scores: FloatArray) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Order of the detected queries, surest first, and where in it each run of equal scores ends."""
    detected = np.flatnonzero(~np.isnan(scores))
    order = detected[np.argsort(-scores[detected], kind="stable")]
    ends = np.append(np.diff(scores[order]) != 0, True) if len(order) else np.empty(0, dtype=bool)
    return order, np.flatnonzero(ends)


def _figures(
    true_positives: npt.NDArray[np.int64], false_positives: npt.NDArray[np.int64], to_find: int
) -> tuple[float, float, float, float, float]:
    """Return R@100P, AP, F1max, EP and recall@1 from counts at falling thresholds."""
    if not to_find:
        return (float("nan"),) * 5
    found = true_positives > 0
    if not found.any():
        return (0.0,) * 5
    true_positives, false_positives = true_positives[found], false_positives[found]
    precision, recall = true_positives / (true_positives + false_positives), true_positives / to_find
    recall_at_100 = float(recall[false_positives == 0].max(initial=0.0))
    average_precision = float(np.sum(precision * np.diff(recall, prepend=0.0)))
    f1_max = float(np.max(2 * precision * recall / (precision + recall)))
    return (
        recall_at_100,
        average_precision,
        f1_max,
        float(precision[0] + recall_at_100) / 2,
        float(recall[-1]),
    )
