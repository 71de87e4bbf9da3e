"""The pair-wise protocol: is this pair of frames one place? The query-wise one is harder; never mix them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.ground_truth import NEGATIVE, POSITIVE, TruthMatrix, loop_ground_truth
from depthprint.evaluation.metrics import LoopMetrics, QueryOutcomes, loop_metrics
from depthprint.recognizer import PlaceRecognizer

__all__ = ["PAIR_PROTOCOL", "MethodPairs", "PairEvaluation", "evaluate_pairs", "sample_pairs"]

PAIR_PROTOCOL = "loops, pair-wise"

Progress = Callable[[int, int], None]
PairArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class MethodPairs:
    """Distances of the sampled pairs and their figures; ``us_per_pair`` is the mean over all pairs."""

    name: str
    distances: npt.NDArray[np.float64]
    metrics: LoopMetrics
    us_per_pair: float


@dataclass(frozen=True)
class PairEvaluation:
    """All methods on the same pairs: ``pairs`` (m, 2) query and candidate, ``positive`` (m,) bool."""

    data: str
    simulated: bool
    rule: str
    seed: int
    pairs: PairArray
    positive: npt.NDArray[np.bool_]
    methods: tuple[MethodPairs, ...]


def sample_pairs(
    truth: TruthMatrix, seed: int, *, negatives_per_positive: int = 100, max_positives: int | None = None
) -> tuple[PairArray, npt.NDArray[np.bool_]]:
    """Draw pairs without replacement: positives, all or ``max_positives``, and so many negatives for each.

    Returns pairs (m, 2) int64, positives first, and (m,) bool. Where there are too few negatives, all are
    taken.
    Raises DataError where the truth holds no positive or no negative pair.
    """
    if negatives_per_positive < 1 or (max_positives is not None and max_positives < 1):
        raise SettingsError(
            "sample_pairs: expected at least 1 negative a positive and 1 positive, got "
            f"{negatives_per_positive} and {max_positives}"
        )
    generator = np.random.default_rng(seed)
    positives, negatives = np.flatnonzero(truth.values == POSITIVE), np.flatnonzero(truth.values == NEGATIVE)
    if not len(positives) or not len(negatives):
        raise DataError(
            "pair-wise protocol: expected positive and negative pairs, got "
            f"{len(positives)} and {len(negatives)}"
        )
    if max_positives is not None and len(positives) > max_positives:
        positives = np.sort(generator.choice(positives, max_positives, replace=False))
    wanted = min(len(negatives), len(positives) * negatives_per_positive)
    negatives = np.sort(generator.choice(negatives, wanted, replace=False))
    flat = np.concatenate([positives, negatives])
    pairs = np.stack(np.divmod(flat, len(truth)), axis=1).astype(np.int64)
    return pairs, np.arange(len(flat)) < len(positives)


def evaluate_pairs(
    sequence: RangeSequence,
    recognizers: Mapping[str, PlaceRecognizer],
    truth: LoopTruth | TruthMatrix | None = None,
    *,
    seed: int = 0,
    negatives_per_positive: int = 100,
    max_positives: int | None = None,
    progress: Progress | None = None,
) -> PairEvaluation:
    """Score fitted recognisers on sampled pairs, by default positive under 3 m and negative over 20 m.

    Unless ``truth`` says else, any heading counts, with the sequence's own gap. Descriptions of all
    frames are held in memory.
    Raises DataError for distances that are not finite.
    """
    if truth is None:
        truth = replace(sequence.truth, kind="distance", positive=3.0, negative=20.0, heading_deg=None)
    matrix = truth if isinstance(truth, TruthMatrix) else loop_ground_truth(sequence, truth)
    if len(matrix) != len(sequence):
        raise DataError(f"{sequence.name}: {len(sequence)} frames but a truth matrix of {len(matrix)}")
    pairs, positive = sample_pairs(
        matrix, seed, negatives_per_positive=negatives_per_positive, max_positives=max_positives
    )
    used = np.unique(pairs)
    total = len(used) + len(pairs) * len(recognizers)
    descriptions: dict[str, dict[int, Any]] = {name: {} for name in recognizers}
    for done, frame in enumerate(used):
        image = sequence[int(frame)]
        for name, recognizer in recognizers.items():
            descriptions[name][int(frame)] = recognizer.describe(image)
        if progress is not None:
            progress(done + 1, total)
    methods = []
    for number, (name, recognizer) in enumerate(recognizers.items()):
        done_before = len(used) + number * len(pairs)
        methods.append(
            _score(name, recognizer, descriptions[name], pairs, positive, done_before, total, progress)
        )
    return PairEvaluation(
        sequence.name, sequence.simulated, matrix.rule, seed, pairs, positive, tuple(methods)
    )


def _score(
    name: str,
    recognizer: PlaceRecognizer,
    descriptions: Mapping[int, Any],
    pairs: PairArray,
    positive: npt.NDArray[np.bool_],
    done_before: int,
    total: int,
    progress: Progress | None,
) -> MethodPairs:
    distances = np.empty(len(pairs))
    started = time.perf_counter()
    for k, (i, j) in enumerate(pairs.tolist()):
        distances[k] = recognizer.distance(descriptions[i], descriptions[j])
        if progress is not None and (k + 1) % 1000 == 0:
            progress(done_before + k + 1, total)
    us_per_pair = (time.perf_counter() - started) / len(pairs) * 1e6
    if progress is not None:
        progress(done_before + len(pairs), total)
    finite = np.isfinite(distances)
    if not finite.all():
        i, j = pairs[int(np.argmin(finite))]
        raise DataError(f"method {name!r}: the distance of frames {i} and {j} is not finite")
    queries = QueryOutcomes(-distances, np.where(positive, 1, -1).astype(np.int8), positive)
    distances.setflags(write=False)
    return MethodPairs(name, distances, loop_metrics(queries), us_per_pair)
