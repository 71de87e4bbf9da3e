"""The causal detector, over a recogniser so simple that every answer is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.errors import ConvergenceError, DataError, ModelError, SettingsError
from depthprint.loop_closure import LoopClosureDetector, LoopStatus, calibrate_threshold
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch

CAMERA = Pinhole(4, 4, 2, 2, 5, 4)


def frame(value: float, **fields) -> RangeImage:
    return RangeImage(np.full((4, 5), value, dtype=np.float32), CAMERA, **fields)


class MeanRange:
    """Describes a frame by its mean range; counts its calls."""

    def __init__(self):
        self.stored: list[float] = []
        self.described = 0

    def fit(self, images):
        return self

    def describe(self, image):
        self.described += 1
        return float(np.nanmean(image.ranges_m))

    def add(self, description):
        self.stored.append(description)
        return len(self.stored) - 1

    def query(self, description, k=1, limit=None):
        distances = [abs(description - s) for s in self.stored[:limit]]
        return [PlaceMatch(int(j), distances[j]) for j in np.argsort(distances, kind="stable")[:k]]

    def distance(self, first, second):
        return abs(first - second)


def test_return_is_found_and_explained():
    detector = LoopClosureDetector(MeanRange(), exclusion_gap=2, threshold=0.5)
    results = [detector.process(frame(v)) for v in (1, 5, 9, 13, 5.25)]
    assert [r.status for r in results] == [LoopStatus.TOO_FEW_PLACES] * 3 + [
        LoopStatus.ABOVE_THRESHOLD,
        LoopStatus.ACCEPTED,
    ]
    last = results[-1]
    assert (last.query, last.match, last.distance, last.candidates, last.accepted) == (4, 1, 0.25, 2, True)
    assert last.explain() == (
        "frame 4: place 1 is the nearest of 2, at distance 0.25, within the threshold 0.5: loop closed"
    )
    assert "above the threshold 0.5" in results[3].explain()
    assert "0 places are more than 2 frames old and 1 are needed" in results[0].explain()
    assert results[0].match is None
    assert results[0].distance is None


@settings(deadline=None)
@given(gap=st.integers(0, 12), count=st.integers(1, 20), least=st.integers(1, 4))
def test_no_match_is_ever_within_the_exclusion_gap(gap, count, least):
    detector = LoopClosureDetector(MeanRange(), exclusion_gap=gap, threshold=1e9, min_places=least)
    for i in range(count):
        result = detector.process(frame(1.0), k=count)
        compared = i - gap >= least
        assert [m.place for m in result.matches] == (list(range(i - gap)) if compared else [])
        assert result.accepted is compared


def test_query_stores_nothing_and_process_describes_once():
    recognizer = MeanRange()
    detector = LoopClosureDetector(recognizer, exclusion_gap=0, threshold=1.0)
    detector.add(frame(2.0))
    before = detector.query(frame(2.0))
    assert detector.query(frame(2.0)) == before
    assert (len(detector), recognizer.stored, recognizer.described) == (1, [2.0], 3)
    assert detector.process(frame(2.0)) == before
    assert (len(detector), recognizer.described) == (2, 4)


def test_places_keep_stamp_pose_and_source():
    detector = LoopClosureDetector(MeanRange(), threshold=1.0)
    pose = np.eye(4)
    assert detector.add(frame(1.0, stamp_s=3.5, source="a.png"), pose=pose) == 0
    detector.process(frame(1.0, stamp_s=3.5), stamp=4.0)
    pose[0, 3] = 7
    first, second = detector.places
    assert (first.stamp_s, first.source, second.stamp_s, second.T_world_sensor) == (3.5, "a.png", 4.0, None)
    np.testing.assert_array_equal(first.T_world_sensor, np.eye(4))
    assert not first.T_world_sensor.flags.writeable


def test_threshold_calibrates_itself_without_ground_truth():
    rng = np.random.default_rng(0)
    places = rng.uniform(1, 100, 400)
    route = np.concatenate([places, places[100:160] + 1e-4])
    detector = LoopClosureDetector(
        MeanRange(), exclusion_gap=50, threshold=None, false_positive_rate=2e-3, calibration_pairs=20
    )
    results = [detector.process(frame(v)) for v in route]
    compared = [r for r in results if r.candidates]
    assert compared[0].status is LoopStatus.CALIBRATING
    assert "too few pairs" in compared[0].explain()
    first_pass, returns = results[200:400], results[400:]
    assert all(r.accepted and r.match == 100 + i for i, r in enumerate(returns))
    pairs = sum(r.candidates for r in first_pass)
    accepted_pairs = sum(
        (np.abs(route[r.query] - route[: r.candidates]) <= r.threshold).sum() for r in first_pass
    )
    assert 0 < accepted_pairs / pairs < 4e-3


def test_calibration_does_not_depend_on_queries_in_between():
    quiet, curious = (LoopClosureDetector(MeanRange(), exclusion_gap=1, threshold=None) for _ in range(2))
    for value in np.random.default_rng(1).uniform(1, 9, 150):
        quiet.add(frame(value))
        curious.query(frame(5.0))
        curious.add(frame(value))
    assert quiet.threshold is not None
    assert quiet.threshold == curious.threshold


@settings(deadline=None)
@given(
    values=st.lists(st.sampled_from([0.0, 0.25, 0.5, 0.75, 1.0]) | st.floats(0, 1), min_size=10, max_size=60),
    rate=st.sampled_from([0.1, 0.2, 0.25, 0.5, 0.9]),
)
def test_calibrated_threshold_is_the_largest_that_keeps_the_rate(values, rate):
    distances = np.array(values)
    threshold = calibrate_threshold(distances, rate)
    assert (distances <= threshold).mean() <= rate + 1e-12
    assert (distances <= np.nextafter(threshold, np.inf)).mean() > rate


@pytest.mark.parametrize(
    ("distances", "rate", "error", "message"),
    [
        (np.ones(9), 0.1, DataError, "at least 10 distances, got 9"),
        ([np.nan] * 10, 0.1, DataError, "finite"),
        (np.ones((5, 4)), 0.1, DataError, "shape"),
        (np.ones(9), 0.0, SettingsError, "rate"),
        (np.ones(9), 1.0, SettingsError, "rate"),
    ],
)
def test_calibration_that_cannot_be_raises(distances, rate, error, message):
    with pytest.raises(error, match=message):
        calibrate_threshold(distances, rate)


@pytest.mark.parametrize("call", ["query", "add", "process"])
def test_unusable_frames_are_named(call):
    detector = LoopClosureDetector(MeanRange(), threshold=1.0)
    detector.add(frame(1.0))
    with pytest.raises(DataError, match="frame 1: expected a RangeImage, got ndarray"):
        getattr(detector, call)(np.ones((4, 5)))
    with pytest.raises(DataError, match=r"frame 1 \(b.png\): expected at least one valid range"):
        getattr(detector, call)(frame(np.nan, source="b.png"))
    assert len(detector) == 1


@pytest.mark.parametrize("pose", [np.eye(3), np.full((4, 4), np.nan)])
def test_malformed_pose_raises_and_stores_nothing(pose):
    recognizer = MeanRange()
    detector = LoopClosureDetector(recognizer, threshold=1.0)
    with pytest.raises(DataError, match="frame 0: expected a finite pose"):
        detector.add(frame(1.0), pose=pose)
    assert (len(detector), recognizer.stored) == (0, [])


@pytest.mark.parametrize(
    "settings",
    [
        {"exclusion_gap": -1},
        {"min_places": 0},
        {"calibration_pairs": 0},
        {"threshold": np.nan},
        {"threshold": None, "false_positive_rate": 0.0},
    ],
)
def test_settings_out_of_range_raise(settings):
    with pytest.raises(SettingsError):
        LoopClosureDetector(MeanRange(), **{"threshold": 1.0, **settings})


def test_misbehaving_recognisers_are_caught():
    detector = LoopClosureDetector(MeanRange(), exclusion_gap=0, threshold=1.0)
    detector.add(frame(1.0))
    with pytest.raises(SettingsError, match="k >= 1"):
        detector.query(frame(1.0), k=0)
    detector.recognizer.query = lambda description, k, limit: [PlaceMatch(0, float("nan"))]
    with pytest.raises(ConvergenceError, match="place 0 is nan"):
        detector.query(frame(1.0))
    detector.recognizer.query = lambda description, k, limit: [PlaceMatch(5, 0.1)]
    with pytest.raises(ModelError, match="proposed place 5"):
        detector.query(frame(1.0))
    detector.recognizer.query = lambda description, k, limit: []
    assert detector.query(frame(1.0)).status is LoopStatus.NO_MATCH
    assert "none of the 1 places" in detector.query(frame(1.0)).explain()
    occupied = MeanRange()
    occupied.add(3.0)
    with pytest.raises(ModelError, match="empty at its start"):
        LoopClosureDetector(occupied, threshold=1.0).add(frame(1.0))


class Hindsight(MeanRange):
    """Proposes nothing near until the frame is reconsidered."""

    def query(self, description, k=1, limit=None):
        return [PlaceMatch(0, 99.0)]

    def reconsider(self, number, k=1):
        return super().query(self.stored[number], k, limit=number - 2)


def test_a_frame_is_answered_again_by_what_is_known_since():
    detector = LoopClosureDetector(Hindsight(), exclusion_gap=2, threshold=0.5)
    at_once = [detector.process(frame(v)) for v in (1, 5, 9, 13, 5.25)][-1]
    assert at_once.status == LoopStatus.ABOVE_THRESHOLD
    later = detector.reconsider(4)
    assert (later.query, later.match, later.status) == (4, 1, LoopStatus.ACCEPTED)
    assert (later.candidates, later.distance) == (at_once.candidates, 0.25)
    assert detector.reconsider(1).status == LoopStatus.TOO_FEW_PLACES
    assert len(detector) == 5
    for number in (-1, 5):
        with pytest.raises(SettingsError, match=f"0 to 4, got {number}"):
            detector.reconsider(number)
    with pytest.raises(SettingsError, match="MeanRange cannot answer"):
        LoopClosureDetector(MeanRange(), threshold=1.0).reconsider(0)


def test_ambiguous_match_names_its_rival():
    detector = LoopClosureDetector(
        MeanRange(), exclusion_gap=0, threshold=0.5, ambiguity=0.5, neighbourhood=1
    )
    for value in (5.0, 9.0, 9.0, 5.02):
        detector.add(frame(value))
    result = detector.query(frame(5.1))
    assert result.status is LoopStatus.AMBIGUOUS
    assert [m.place for m in result.matches] == [3, 0]
    assert "place 0, elsewhere, is about as near" in result.explain()
    assert detector.query(frame(5.02 + 1e-4)).status is LoopStatus.ACCEPTED
    assert detector.query(frame(9.01)).status is LoopStatus.ACCEPTED


def test_match_that_no_recent_frame_supports_is_inconsistent():
    detector = LoopClosureDetector(
        MeanRange(), exclusion_gap=4, threshold=0.5, consistent_frames=1, neighbourhood=1
    )
    results = [detector.process(frame(v)) for v in (1, 2, 3, 4, 20, 30, 40, 50, 1, 2)]
    assert results[8].status is LoopStatus.INCONSISTENT_IN_TIME
    assert "no recent frame was matched nearby" in results[8].explain()
    assert results[9].accepted
    assert results[9].match == 1


def test_probability_of_a_return_is_high_and_of_a_new_place_low():
    rng = np.random.default_rng(2)
    route = np.repeat(rng.permutation(120) * 1.0 + 1, 2) + rng.normal(0, 0.05, 240)
    detector = LoopClosureDetector(MeanRange(), exclusion_gap=10, threshold=0.3, probabilities=True)
    results = [detector.process(frame(v)) for v in route]
    assert results[5].probability is None
    returning = detector.query(frame(float(route[40])), k=3)
    elsewhere = detector.query(frame(400.0), k=3)
    assert returning.probability_new < elsewhere.probability_new
    assert elsewhere.probability_new > 0.5
    assert 0 <= elsewhere.probability <= elsewhere.probability + elsewhere.probability_new <= 1 + 1e-9


def test_far_places_are_told_by_odometry_where_asked():
    def at(x: float) -> np.ndarray:
        pose = np.eye(4)
        pose[0, 3] = x
        return pose

    near, far = (
        LoopClosureDetector(MeanRange(), exclusion_gap=1000, threshold=None, far_m=far_m, calibration_pairs=3)
        for far_m in (1e6, 5.0)
    )
    for i in range(400):
        for detector in (near, far):
            detector.add(frame(1.0 + i % 7), pose=at(float(i)))
    assert near.threshold is None
    assert far.threshold is not None


@pytest.mark.parametrize(
    "settings", [{"far_m": 0.0}, {"ambiguity": -1.0}, {"consistent_frames": -1}, {"neighbourhood": -1}]
)
def test_new_settings_out_of_range_raise(settings):
    with pytest.raises(SettingsError, match=next(iter(settings))):
        LoopClosureDetector(MeanRange(), threshold=1.0, **settings)
