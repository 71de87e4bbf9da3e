"""The query-wise causal protocol, one for every method: each frame asks the past, then joins it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.ground_truth import TruthMatrix, loop_ground_truth
from depthprint.evaluation.loop_record import LoopRecord
from depthprint.evaluation.metrics import (
    Interval,
    LoopMetrics,
    PrecisionRecall,
    QueryOutcomes,
    bootstrap_intervals,
    loop_metrics,
    precision_recall,
)
from depthprint.evaluation.pose_errors import PoseErrors, match_pose_error, pose_errors
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch, PlaceRecognizer, ReconsideringRecognizer

__all__ = ["LOOP_PROTOCOL", "LoopEvaluation", "MethodLoops", "evaluate_loops", "score_records"]

LOOP_PROTOCOL = "loops, query-wise and causal"

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class MethodLoops:
    """What one method did. ``records`` and ``queries`` hold every frame that had a candidate, in time order.

    describe_ms, query_ms: median milliseconds a frame, the latter over frames that had candidates.
    ms_per_query: median of their sum. delay: frames after which it answered again, query_ms then being of both answers.
    """

    name: str
    records: tuple[LoopRecord, ...]
    queries: QueryOutcomes
    metrics: LoopMetrics
    intervals: Mapping[str, Interval]
    describe_ms: float
    query_ms: float
    ms_per_query: float
    delay: int = 0

    @property
    def pose_errors(self) -> PoseErrors:
        """Medians of the errors of T_match_query over accepted right matches."""
        return pose_errors(self.records)

    @property
    def curve(self) -> PrecisionRecall:
        """Precision and recall at every distinct score."""
        return precision_recall(self.queries)


@dataclass(frozen=True)
class LoopEvaluation:
    """All methods on one sequence."""

    data: str
    simulated: bool
    truth: TruthMatrix
    seed: int
    methods: tuple[MethodLoops, ...]

    def __iter__(self) -> Iterator[MethodLoops]:
        return iter(self.methods)


def evaluate_loops(
    sequence: RangeSequence,
    recognizers: Mapping[str, PlaceRecognizer],
    truth: LoopTruth | TruthMatrix | None = None,
    *,
    seed: int = 0,
    resamples: int = 1000,
    delay: int = 0,
    progress: Progress | None = None,
) -> LoopEvaluation:
    """Run fitted, empty recognisers over a sequence and score them: describe, query the past, add.

    truth: a rule, a matrix already made (of the sequence's length), or None for the sequence's own rule.
    ``seed`` and ``resamples`` serve the bootstrap intervals. A frame is read once and described once per method. The
    score of a match is its negated distance.
    delay: methods that can answer for a frame again do so when that many have followed it, or the sequence ends, as
    NAME-delay-N beside NAME.
    Raises SettingsError for a negative delay, DataError for a truth of another length, a recogniser that is not
    empty, names a place it must not see yet, or returns a distance that is not finite.
    """
    if delay < 0:
        raise SettingsError(f"evaluate_loops: expected delay >= 0, got {delay}")
    n = len(sequence)
    rule = sequence.truth if truth is None else truth
    # reprojecting views takes long enough to be part of the progress; distances do not
    before = 2 * n if isinstance(rule, LoopTruth) and rule.kind == "overlap" else 0

    def report_truth(done: int, total: int) -> None:
        if progress is not None:
            progress(done, before + n)

    matrix = loop_ground_truth(sequence, rule, report_truth) if isinstance(rule, LoopTruth) else rule
    if len(matrix) != n:
        raise DataError(f"{sequence.name}: {n} frames but a truth matrix of {len(matrix)}")
    runs = [_Run(name, recognizer, matrix, sequence.poses, delay) for name, recognizer in recognizers.items()]
    for frame in range(n):
        image = sequence[frame]
        for run in runs:
            run.step(frame, image)
        if progress is not None:
            progress(before + frame + 1, before + n)
    return LoopEvaluation(
        data=sequence.name,
        simulated=sequence.simulated,
        truth=matrix,
        seed=seed,
        methods=tuple(result for run in runs for result in run.results(seed, resamples)),
    )


class _Run:
    """One method's way through the sequence."""

    def __init__(
        self,
        name: str,
        recognizer: PlaceRecognizer,
        truth: TruthMatrix,
        poses: npt.NDArray[np.float64] | None,
        delay: int,
    ) -> None:
        self.name = name
        self.delay = delay if isinstance(recognizer, ReconsideringRecognizer) else 0
        self.later: list[LoopRecord] = []
        self.reconsider_s: list[float] = []
        self.recognizer = recognizer
        self.truth = truth
        self.poses = poses
        self.has_positive = truth.has_positive
        self.records: list[LoopRecord] = []
        self.describe_s: list[float] = []
        self.query_s: list[float] = []

    def step(self, frame: int, image: RangeImage) -> None:
        started = time.perf_counter()
        description = self.recognizer.describe(image)
        described = time.perf_counter()
        self.describe_s.append(described - started)
        limit = self.truth.candidates(frame)
        if limit:
            matches = self.recognizer.query(description, k=1, limit=limit)
            self.query_s.append(time.perf_counter() - described)
            self.records.append(self._record(frame, limit, matches))
        place = self.recognizer.add(description)
        if place != frame:
            raise DataError(
                f"method {self.name!r}: expected frame {frame} to become place {frame}, it became {place}"
            )
        if self.delay:
            last = frame == len(self.truth) - 1
            for number in range(max(0, frame - self.delay), frame + 1 if last else frame - self.delay + 1):
                self._reconsider(number)

    def _reconsider(self, number: int) -> None:
        limit = self.truth.candidates(number)
        if limit and isinstance(self.recognizer, ReconsideringRecognizer):
            started = time.perf_counter()
            matches = self.recognizer.reconsider(number)
            self.reconsider_s.append(time.perf_counter() - started)
            self.later.append(self._record(number, limit, matches))

    def _record(self, frame: int, limit: int, matches: list[PlaceMatch]) -> LoopRecord:
        has_positive = bool(self.has_positive[frame])
        if not matches:
            return LoopRecord(frame, -1, float("nan"), None, 0, has_positive)
        best = matches[0]
        if not 0 <= best.place < limit:
            raise DataError(
                f"method {self.name!r}, frame {frame}: expected a match among places 0..{limit - 1}, "
                f"got {best.place}"
            )
        if not np.isfinite(best.distance):
            raise DataError(
                f"method {self.name!r}, frame {frame}: expected a finite distance, got {best.distance}"
            )
        outcome = int(self.truth.values[frame, best.place])
        return LoopRecord(
            frame,
            best.place,
            float(best.distance),
            best.shift,
            outcome,
            has_positive,
            *self._pose_error(frame, best),
        )

    def _pose_error(self, frame: int, match: PlaceMatch) -> tuple[float | None, float | None]:
        found = match.verification
        if self.poses is None or found is None or not found.accepted:
            return None, None
        return match_pose_error(found.T_match_query, self.poses[match.place], self.poses[frame])

    def results(self, seed: int, resamples: int) -> Iterator[MethodLoops]:
        yield self._scored(self.name, self.records, self.query_s, seed, resamples)
        if self.delay:
            both_s = np.add(self.query_s, self.reconsider_s).tolist()
            name = f"{self.name}-delay-{self.delay}"
            yield replace(self._scored(name, self.later, both_s, seed, resamples), delay=self.delay)

    def _scored(
        self, name: str, records: Sequence[LoopRecord], query_s: list[float], seed: int, resamples: int
    ) -> MethodLoops:
        with_candidates = self.describe_s[len(self.describe_s) - len(query_s) :]
        return score_records(
            name,
            records,
            seed,
            resamples,
            describe_ms=_median_ms(self.describe_s),
            query_ms=_median_ms(query_s),
            ms_per_query=_median_ms(np.add(with_candidates, query_s)),
        )


def score_records(
    name: str,
    records: Sequence[LoopRecord],
    seed: int,
    resamples: int = 1000,
    *,
    describe_ms: float = float("nan"),
    query_ms: float = float("nan"),
    ms_per_query: float = float("nan"),
) -> MethodLoops:
    """Figures and bootstrap intervals of one method's records, in time order, one for each frame with candidates."""
    queries = QueryOutcomes(
        np.array([-r.distance for r in records], dtype=np.float64),
        np.array([r.outcome for r in records], dtype=np.int8),
        np.array([r.has_positive for r in records], dtype=bool),
    )
    return MethodLoops(
        name=name,
        records=tuple(records),
        queries=queries,
        metrics=loop_metrics(queries),
        intervals=bootstrap_intervals(queries, seed, resamples=resamples),
        describe_ms=describe_ms,
        query_ms=query_ms,
        ms_per_query=ms_per_query,
    )


def _median_ms(seconds: list[float] | npt.NDArray[np.float64]) -> float:
    return float(np.median(seconds) * 1e3) if len(seconds) else float("nan")
