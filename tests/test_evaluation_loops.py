from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.ground_truth import TruthMatrix, loop_ground_truth
from depthprint.evaluation.loops import evaluate_loops
from depthprint.evaluation.pairs import evaluate_pairs, sample_pairs
from depthprint.evaluation.report import (
    loop_records,
    loop_report,
    metric_rows,
    pair_report,
    results_table,
)
from depthprint.projection import LaserRow, Pinhole
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch
from depthprint.run_folder import json_ready
from depthprint.verification.verifier import Verification

N = 40
GAP = 5


class Nearest:
    """Compares the first beam of each frame, which holds the position along the lap."""

    def __init__(self, noise: float = 0.0) -> None:
        self.places: list[float] = []
        self.described = 0
        self.limits: list[int | None] = []
        self.noise = noise

    def fit(self, images: Sequence[RangeImage]) -> Nearest:
        return self

    def describe(self, image: RangeImage) -> float:
        self.described += 1
        return float(image.ranges_m[0, 0]) + self.noise * np.sin(7.0 * self.described)

    def add(self, description: float) -> int:
        self.places.append(description)
        return len(self.places) - 1

    def query(self, description: float, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        self.limits.append(limit)
        distances = np.abs(np.array(self.places[:limit]) - description)
        return [PlaceMatch(int(j), float(distances[j])) for j in np.argsort(distances, kind="stable")[:k]]

    def distance(self, first: float, second: float) -> float:
        return abs(first - second)


class MeasuresPoses(Nearest):
    """Every match comes with the same pose, accepted."""

    def __init__(self, T_match_query: np.ndarray) -> None:
        super().__init__()
        self.found = Verification(T_match_query, 99, 0.9, 0, 0.0, 0.1, True, "", "")

    def query(self, description, k=1, limit=None):
        return [replace(m, verification=self.found) for m in super().query(description, k, limit)]


class SeesTheFuture(Nearest):
    def query(self, description, k=1, limit=None):
        return [PlaceMatch(len(self.places) - 1, 0.0)]


class SkipsPlaces(Nearest):
    def add(self, description):
        return super().add(description) + 1


class ReturnsNoNumber(Nearest):
    def query(self, description, k=1, limit=None):
        return [PlaceMatch(0, float("nan"))]

    def distance(self, first, second):
        return float("nan")


class NeverSure(Nearest):
    def query(self, description, k=1, limit=None):
        return []


class SureLater(NeverSure):
    """Finds no place before three more frames are known."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[tuple[int, int]] = []

    def reconsider(self, number, k=1):
        self.asked.append((number, len(self.places)))
        return Nearest.query(self, self.places[number], k, number - GAP)


def two_laps() -> RangeSequence:
    """Two laps of 20 stops each, 10 m apart, along one line."""
    laser = LaserRow(2, 0.0, 0.1)
    poses = np.tile(np.eye(4), (N, 1, 1))
    poses[:, 0, 3] = 10.0 * (np.arange(N) % 20)

    def read(i: int) -> RangeImage:
        return RangeImage(np.full((1, 2), 1.0 + poses[i, 0, 3], dtype=np.float32), laser)

    truth = LoopTruth(gap=GAP, positive=4.0, negative=10.0)
    return RangeSequence("two laps", read, N, "laser", poses, truth=truth, simulated=True)


def test_perfect_method_finds_every_loop_and_asks_the_past_only():
    method = Nearest()
    calls: list[tuple[int, int]] = []
    evaluation = evaluate_loops(
        two_laps(), {"nearest": method}, resamples=20, progress=lambda d, t: calls.append((d, t))
    )
    (result,) = evaluation
    assert result.metrics.recall_at_100_precision == 1.0
    assert result.metrics.average_precision == 1.0
    assert method.described == N
    assert method.limits == [i - GAP for i in range(GAP + 1, N)]
    assert [r.query for r in result.records] == list(range(GAP + 1, N))
    assert [r.match for r in result.records if r.has_positive] == list(range(20))
    assert calls == [(i + 1, N) for i in range(N)]
    assert result.ms_per_query > 0


def test_method_that_never_matches_finds_nothing():
    (result,) = evaluate_loops(two_laps(), {"none": NeverSure()}, resamples=5)
    assert result.metrics.recall_at_1 == 0.0
    assert all(r.match == -1 for r in result.records)
    _, rows = loop_records(result)
    assert rows[0][1] is None


def test_methods_that_can_answer_again_later_have_a_row_of_that_too():
    method = SureLater()
    evaluation = evaluate_loops(two_laps(), {"late": method, "nearest": Nearest()}, resamples=5, delay=3)
    assert [m.name for m in evaluation] == ["late", "late-delay-3", "nearest"]
    at_once, later, _ = evaluation
    assert at_once.metrics.recall_at_1 == 0.0
    assert later.metrics.recall_at_100_precision == 1.0
    assert [r.query for r in later.records] == [r.query for r in at_once.records]
    # Three frames on, and at the end whatever there is.
    assert method.asked == [(i, min(i + 4, N)) for i in range(GAP + 1, N)]
    methods = loop_report(evaluation, {})["methods"]
    assert {name: figures.get("delay") for name, figures in methods.items()} == {
        "late": None,
        "late-delay-3": 3,
        "nearest": None,
    }
    assert later.query_ms >= at_once.query_ms
    with pytest.raises(SettingsError, match="delay >= 0, got -1"):
        evaluate_loops(two_laps(), {"nearest": Nearest()}, delay=-1)


@pytest.mark.parametrize(
    ("method", "message"),
    [(SeesTheFuture(), "among places"), (SkipsPlaces(), "become place"), (ReturnsNoNumber(), "finite")],
)
def test_methods_that_break_the_protocol_are_named(method, message):
    with pytest.raises(DataError, match=f"'bad'.*{message}"):
        evaluate_loops(two_laps(), {"bad": method}, resamples=5)


def test_truth_of_another_length_is_refused():
    other = TruthMatrix(np.zeros((3, 3), dtype=np.int8), GAP, "other")
    with pytest.raises(DataError, match="40 frames but a truth matrix of 3"):
        evaluate_loops(two_laps(), {"nearest": Nearest()}, other)


def test_report_holds_the_agreed_names_and_survives_json():
    evaluation = evaluate_loops(
        two_laps(), {"exact": Nearest(), "noisy": Nearest(30.0)}, seed=3, resamples=20
    )
    report = loop_report(evaluation, {"preset": "laser"})
    read_back = json.loads(json.dumps(json_ready(report), allow_nan=False))
    assert {"protocol", "data", "seed", "counts", "settings", "versions", "methods"} <= set(read_back)
    names = {"recall_at_100_precision", "average_precision", "f1_max", "extended_precision", "recall_at_1"}
    assert names | {"ms_per_query"} <= set(read_back["methods"]["noisy"])
    assert read_back["simulated"] is True
    assert read_back["counts"]["positive_queries"] == 20
    assert (
        read_back["methods"]["exact"]["average_precision"]
        > read_back["methods"]["noisy"]["average_precision"]
    )
    header, rows = metric_rows(report)
    assert [row[0] for row in rows] == ["exact", "noisy"]
    assert all(len(row) == len(header) for row in rows)
    assert rows[0][header.index("f1_max")] == 1.0


def turned(degrees: float, forward_m: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    T = np.eye(4)
    T[:2, :2] = (c, -s), (s, c)
    T[0, 3] = forward_m
    return T


@pytest.mark.parametrize(("degrees", "metres"), [(0.0, 0.0), (1e-4, 0.25), (3.0, 0.1), (120.0, 2.0)])
def test_errors_of_measured_poses_are_told_where_truth_has_poses(degrees, metres):
    both = {"posed": MeasuresPoses(turned(degrees, metres)), "plain": Nearest()}
    evaluation = evaluate_loops(two_laps(), both, resamples=5)
    found = evaluation.methods[0].pose_errors
    assert found.count == 20
    assert found.translation_m == pytest.approx(metres, abs=1e-12)
    assert found.rotation_deg == pytest.approx(degrees, abs=1e-9)
    assert evaluation.methods[1].pose_errors.count == 0
    report = loop_report(evaluation, {})
    assert report["methods"]["posed"]["poses_measured"] == 20
    assert report["methods"]["posed"]["translation_error_m"] == pytest.approx(metres, abs=1e-12)
    assert json_ready(report)["methods"]["plain"]["rotation_error_deg"] is None
    titles = [str(column.header) for column in results_table(report).columns]
    assert {"pose, m", "pose, deg"} <= set(titles)


def test_poses_are_not_scored_without_truth_for_them_or_without_acceptance():
    unposed = replace(two_laps(), poses=None)
    matrix = loop_ground_truth(two_laps(), two_laps().truth)
    (result,) = evaluate_loops(unposed, {"posed": MeasuresPoses(np.eye(4))}, matrix, resamples=5)
    assert result.pose_errors.count == 0
    refused = MeasuresPoses(np.eye(4))
    refused.found = replace(refused.found, accepted=False)
    evaluation = evaluate_loops(two_laps(), {"refused": refused}, resamples=5)
    assert evaluation.methods[0].pose_errors.count == 0
    assert "translation_error_m" not in loop_report(evaluation, {})["methods"]["refused"]


def test_terminal_table_names_the_data_and_says_simulated():
    from rich.console import Console

    report = loop_report(evaluate_loops(two_laps(), {"exact": Nearest()}, resamples=20), {})
    console = Console(width=160, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(results_table(report))
    console.file.close()
    text = console.export_text()
    for part in ("two laps", "simulated", "R@100P", "1.000", "20 positive queries", "1.00-1.00"):
        assert part in text


def test_pairs_are_drawn_once_and_repeat_for_a_seed():
    truth = loop_ground_truth(two_laps())
    pairs, positive = sample_pairs(truth, 0, negatives_per_positive=3)
    assert positive.sum() == 20
    assert len(pairs) == 80
    assert len({tuple(p) for p in pairs.tolist()}) == 80
    assert (truth.values[pairs[:, 0], pairs[:, 1]] == np.where(positive, 1, -1)).all()
    again, _ = sample_pairs(truth, 0, negatives_per_positive=3)
    other, _ = sample_pairs(truth, 1, negatives_per_positive=3)
    assert np.array_equal(pairs, again)
    assert not np.array_equal(pairs, other)
    few, positive = sample_pairs(truth, 0, negatives_per_positive=2, max_positives=4)
    assert (len(few), positive.sum()) == (12, 4)


def test_pair_protocol_separates_near_from_far():
    evaluation = evaluate_pairs(
        two_laps(), {"exact": Nearest(), "noisy": Nearest(60.0)}, negatives_per_positive=5
    )
    exact, noisy = evaluation.methods
    assert exact.metrics.average_precision == 1.0
    assert noisy.metrics.average_precision < 0.9
    report = pair_report(evaluation, {})
    assert "recall_at_1" not in report["methods"]["exact"]
    assert report["counts"] == {"positive_pairs": 20, "negative_pairs": 100}


def test_pair_protocol_needs_both_kinds_and_finite_distances():
    sequence = two_laps()
    with pytest.raises(DataError, match="0"):
        evaluate_pairs(sequence, {"exact": Nearest()}, LoopTruth(gap=38))
    with pytest.raises(DataError, match="'bad'"):
        evaluate_pairs(sequence, {"bad": ReturnsNoNumber()}, negatives_per_positive=1)
    with pytest.raises(SettingsError, match="negative"):
        sample_pairs(loop_ground_truth(sequence), 0, negatives_per_positive=0)


def test_progress_includes_the_truth_of_view_overlap():
    camera = Pinhole(6.0, 6.0, 3.5, 2.5, 8, 6)
    blank = RangeImage(np.ones((6, 8), dtype=np.float32), camera)
    rule = LoopTruth("overlap", gap=1, positive=0.5, negative=0.3)
    sequence = RangeSequence(
        "wall", lambda i: blank, 4, "handheld", np.tile(np.eye(4), (4, 1, 1)), truth=rule
    )
    calls: list[tuple[int, int]] = []
    (result,) = evaluate_loops(
        sequence, {"exact": Nearest()}, resamples=5, progress=lambda done, total: calls.append((done, total))
    )
    assert {total for _, total in calls} == {12}
    assert [done for done, _ in calls] == sorted({done for done, _ in calls})
    assert calls[-1][0] == 12
    assert result.metrics.recall_at_1 == 1.0


def test_threshold_is_reported_as_a_distance():
    report = loop_report(evaluate_loops(two_laps(), {"exact": Nearest()}, resamples=5), {})
    assert report["methods"]["exact"]["distance_at_100_precision"] == 0.0


def test_sequence_without_loops_reports_null():
    sequence = replace(two_laps(), truth=LoopTruth(gap=25, positive=1.0, negative=2.0))
    assert sequence.poses is not None
    sequence.poses[:, 0, 3] = 10.0 * np.arange(N)
    report = loop_report(evaluate_loops(sequence, {"exact": Nearest()}, resamples=5), {})
    assert json_ready(report)["methods"]["exact"]["average_precision"] is None
    assert results_table(report).row_count == 1
