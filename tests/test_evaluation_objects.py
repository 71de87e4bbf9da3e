from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.datasets.base import ObjectSet, ObjectView
from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.memory import machine_bytes, require_room_for_pairs
from depthprint.evaluation.object_methods import PrecomputedDistanceMethod
from depthprint.evaluation.object_queries import turn_queries
from depthprint.evaluation.object_splits import (
    category_folds,
    instance_split,
    named_trials,
    random_trials,
    select_views,
)
from depthprint.evaluation.objects import ObjectProtocol, evaluate_objects, paired_difference
from depthprint.evaluation.report import metric_rows, object_report, object_rows, results_table
from depthprint.partial_views import hide_part
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage

CAMERA = Pinhole(10.0, 10.0, 1.0, 1.0, 2, 2)
ELEVATIONS = {1: 30.0, 2: 45.0, 4: 60.0}


def views_of(counts: dict[str, int], videos=(1, 2, 4), frames=(1, 2)) -> list[ObjectView]:
    return [
        ObjectView(c, f"{c}_{k + 1}", v, f, f"{c}_{k + 1}_{v}_{f}.png")
        for c, n in counts.items()
        for k in range(n)
        for v in videos
        for f in frames
    ]


def object_set(counts: dict[str, int], **kwargs) -> ObjectSet:
    """Objects whose depth tells category (tens) and instance (units)."""
    views = views_of(counts, **kwargs)
    categories = sorted(counts)

    def read(view: ObjectView) -> RangeImage:
        depth = 10.0 * (1 + categories.index(view.category)) + int(view.instance.split("_")[1])
        return RangeImage(np.full((2, 2), depth, dtype=np.float32), CAMERA)

    return ObjectSet("made", views, read, ELEVATIONS, simulated=True)


def depths(images, progress=None) -> np.ndarray:
    return np.array([float(image.ranges_m[0, 0]) for image in images])


def by_depth() -> PrecomputedDistanceMethod:
    return PrecomputedDistanceMethod(lambda d, progress: np.abs(d[:, None] - d), "depth", depths)


def by_chance(seed: int) -> PrecomputedDistanceMethod:
    def matrix(images, progress=None):
        return np.random.default_rng(seed).random((len(images), len(images)))

    return PrecomputedDistanceMethod(matrix, f"chance{seed}")


@settings(deadline=None)
@given(st.lists(st.integers(2, 7), min_size=1, max_size=5), st.integers(0, 1000))
def test_every_object_is_tested_exactly_once(sizes, seed):
    views = views_of({f"c{k}": n for k, n in enumerate(sizes)})
    folds = category_folds(views, seed)
    assert len(folds) == max(sizes)
    tested = np.concatenate([test for _, test in folds])
    assert sorted(tested.tolist()) == list(range(len(views)))
    for train, test in folds:
        left_out = {views[k].instance for k in test}
        assert left_out.isdisjoint(views[k].instance for k in train)
        assert {views[k].category for k in test} <= {views[k].category for k in train}
        assert len(left_out) == len({views[k].category for k in test})


def test_the_seed_draws_the_order_of_the_folds():
    views = views_of({"a": 6, "b": 6, "c": 6})
    first, same, other = (category_folds(views, seed) for seed in (0, 0, 1))
    assert all(np.array_equal(x[1], y[1]) for x, y in zip(first, same, strict=True))
    assert not all(np.array_equal(x[1], y[1]) for x, y in zip(first, other, strict=True))


def test_category_of_one_object_cannot_be_tested():
    with pytest.raises(DataError, match=r"\['alone'\]"):
        category_folds(views_of({"alone": 1, "pair": 2}), 0)


def test_instances_are_trained_on_30_and_60_and_tested_on_45_degrees():
    views = views_of({"a": 2})
    train, test = instance_split(views, ELEVATIONS)
    assert {views[k].video for k in train} == {1, 4}
    assert {views[k].video for k in test} == {2}


def test_views_are_selected_by_frame_number():
    objects = object_set({"a": 2}, frames=range(1, 11))
    assert {v.frame for v in select_views(objects, (1, 4, 7))} == {1, 4, 7}
    assert len(select_views(objects)) == 60
    with pytest.raises(DataError, match="99"):
        select_views(objects, (1, 99))


def test_telling_depth_solves_both_protocols_and_chance_does_not():
    objects = object_set(dict.fromkeys("abcd", 3))
    evaluation = evaluate_objects(objects, [by_depth(), by_chance(0), by_chance(1)], seed=1)
    depth, chance, other = evaluation.methods
    assert depth.category_accuracy_mean == depth.instance_accuracy == 1.0
    assert depth.category_accuracy_std == 0.0
    assert depth.us_per_pair > 0
    assert chance.category_accuracy_mean < 0.7
    assert chance.instance_accuracy < 0.5
    assert chance.category_accuracy_mean == pytest.approx(np.mean(chance.object_accuracies))
    low, high = chance.intervals["category_accuracy_mean"]
    assert low < chance.category_accuracy_mean < high
    confusion = evaluation.confusion(depth)
    assert confusion.tolist() == (18 * np.eye(4, dtype=int)).tolist()
    versus = {(d.first, d.second): d for d in evaluation.category_differences}
    assert not versus["depth", "chance0"].is_noise
    assert versus["chance0", "chance1"].is_noise
    assert other.name == "chance1"
    assert len(evaluation.instance_differences) == 3


def test_accuracy_is_averaged_by_category_not_by_view():
    objects = object_set({"a": 2, "b": 2})
    views = list(objects.views) + [ObjectView("b", "b_1", 9, f, "") for f in range(30)]
    uneven = ObjectSet("made", views, objects.read, ELEVATIONS)

    class AlwaysA:
        name, us_per_pair = "a", float("nan")

        def prepare(self, images, progress=None):
            return None

        def predict(self, train, train_labels, test):
            return np.full(len(test), train_labels.min())

    (result,) = evaluate_objects(uneven, [AlwaysA()]).methods
    assert result.fold_accuracies == (0.5, 0.5)


def test_set_without_the_elevations_has_no_instance_figure():
    evaluation = evaluate_objects(object_set({"a": 2, "b": 2}, videos=(1,)), [by_depth()])
    assert np.isnan(evaluation.methods[0].instance_accuracy)
    assert evaluation.n_instance_tests == 0


def test_paired_difference_and_its_error():
    difference = paired_difference(
        "x", "y", np.array([1.0, 0.5, 1.0, np.nan]), np.array([0.5, 0.5, 0.0, 1.0])
    )
    assert difference.mean == pytest.approx(0.5)
    assert difference.standard_error == pytest.approx(0.5 / np.sqrt(3))
    assert difference.is_noise
    assert not paired_difference("x", "y", np.ones(3), np.zeros(3)).is_noise
    with pytest.raises(DataError, match="two objects"):
        paired_difference("x", "y", np.ones(1), np.ones(1))


def test_report_of_objects_has_the_agreed_names():
    evaluation = evaluate_objects(object_set({"a": 2, "b": 3}), [by_depth(), by_chance(0)], frames=(1,))
    report = object_report(evaluation, {"preset": "object"})
    assert {"category_accuracy_mean", "category_accuracy_std", "instance_accuracy", "us_per_pair"} <= set(
        report["methods"]["depth"]
    )
    assert report["counts"]["folds"] == 3
    assert report["settings"]["frames"] == (1,)
    assert report["category_differences"][0]["first"] == "depth"
    header, rows = metric_rows(report)
    assert len(header) == len(rows[0])
    header, rows = object_rows(evaluation)
    assert len(rows) == len(evaluation.views)
    assert rows[0][header.index("depth")] == rows[0][header.index("category")]
    assert results_table(report).row_count == 2


def test_method_must_give_good_distances():
    images = [RangeImage(np.ones((2, 2), dtype=np.float32), CAMERA)] * 3
    with pytest.raises(DataError, match="prepare"):
        by_depth().predict(np.array([0]), np.array([0]), np.array([1]))
    with pytest.raises(DataError, match=r"\(3, 3\)"):
        PrecomputedDistanceMethod(lambda i, p: np.zeros((2, 2)), "small").prepare(images)
    with pytest.raises(DataError, match="views 0 and 0"):
        PrecomputedDistanceMethod(lambda i, p: np.full((3, 3), np.nan), "nan").prepare(images)


def test_methods_must_have_different_names():
    with pytest.raises(SettingsError, match="names"):
        evaluate_objects(object_set({"a": 2}), [by_depth(), by_depth()])


def test_queries_of_several_views_follow_the_turn_and_wrap():
    views = views_of({"a": 2}, videos=(1, 2), frames=(1, 2, 3, 4))
    test = np.arange(len(views))[::-1].copy()
    queries = turn_queries(views, test, 3)
    for position, members in enumerate(queries):
        first = views[test[position]]
        chosen = [views[test[m]] for m in members]
        assert {(v.instance, v.video) for v in chosen} == {(first.instance, first.video)}
        assert [v.frame for v in chosen] == [(first.frame - 1 + k) % 4 + 1 for k in range(3)]
    with pytest.raises(DataError, match="a_2, video 2: expected 5 views"):
        turn_queries(views, test, 5)


def test_three_views_outvote_a_bad_one():
    objects = object_set(dict.fromkeys("ab", 2), frames=(1, 2, 3))

    def matrix(d, progress=None):
        distances = np.abs(d[:, None] - d)
        bad = np.array([v.frame == 2 for v in objects.views])
        distances[bad] = 30 - distances[bad]
        return np.abs(np.minimum(distances, 30))

    def accuracy(n_views):
        method = PrecomputedDistanceMethod(matrix, "m", depths)
        protocol = ObjectProtocol(views_per_query=n_views)
        return evaluate_objects(objects, [method], protocol=protocol).methods[0].category_accuracy_mean

    assert accuracy(1) == pytest.approx(2 / 3)
    assert accuracy(3) == 1.0


def test_method_that_grades_no_labels_cannot_sum_views():
    class Mute:
        name, us_per_pair = "mute", float("nan")

        def prepare(self, images, progress=None):
            return None

        def predict(self, train, train_labels, test):
            return np.full(len(test), train_labels.min())

    with pytest.raises(SettingsError, match="mute: grades no labels"):
        evaluate_objects(object_set({"a": 2, "b": 2}), [Mute()], protocol=ObjectProtocol(views_per_query=2))


def disc() -> RangeImage:
    y, x = np.mgrid[:60, :80]
    mask = np.hypot(x - 40, y - 30) < 20
    camera = Pinhole(500.0, 500.0, 40.0, 30.0, 80, 60)
    return RangeImage(np.where(mask, 1.0, 1.2).astype(np.float32), camera, mask=mask)


@settings(deadline=None, max_examples=25)
@given(st.floats(0, 0.9), st.integers(0, 100))
def test_a_half_plane_hides_its_share_and_the_crop_follows(share, seed):
    whole = disc()
    hidden = hide_part(whole, share, np.random.default_rng(seed))
    assert hidden.mask.sum() == round(whole.mask.sum() * (1 - share))
    rows, columns = np.nonzero(hidden.mask)
    assert min(rows.min(), columns.min()) <= 2
    assert (hidden.ranges_m[hidden.mask] == 1.0).all()
    assert np.isnan(hidden.ranges_m).sum() <= whole.mask.sum() - hidden.mask.sum()
    # Pixels keep their place on the camera's image.
    points = hidden.points()[hidden.mask]
    known = whole.points()[whole.mask]
    assert {tuple(p) for p in points.round(5)} <= {tuple(p) for p in known.round(5)}


def test_only_queries_are_hidden():
    seen = []

    class Watcher(PrecomputedDistanceMethod):
        def predict(self, train, train_labels, test):
            seen.append((train.max(), test.min()))
            return super().predict(train, train_labels, test)

    base = object_set({"a": 2, "b": 2})
    whole = disc()
    objects = ObjectSet("made", base.views, lambda view: whole, ELEVATIONS)
    watcher = Watcher(lambda d, progress: np.abs(d[:, None] - d), "w", lambda i, p: np.arange(len(i)) * 1.0)
    evaluation = evaluate_objects(objects, [watcher], protocol=ObjectProtocol(hidden=0.4))
    assert all(train < len(base.views) <= test for train, test in seen)
    assert "40% of each query hidden" in evaluation.protocol.words


def test_random_trials_leave_out_one_object_of_each_category():
    views = views_of({"a": 3, "b": 4})
    trials = random_trials(views, 10, 0)
    assert len(trials) == 10
    assert len({tuple(test) for _, test in trials}) > 1
    for train, test in trials:
        assert sorted({views[k].category for k in test}) == ["a", "b"]
        assert len({views[k].instance for k in test}) == 2
        assert {views[k].instance for k in test}.isdisjoint(views[k].instance for k in train)


def test_published_trials_are_followed_and_untested_objects_do_not_count():
    objects = object_set({"a": 3, "b": 3})
    protocol = ObjectProtocol(left_out=(("a_1", "b_2"), ("a_1", "b_3")))
    evaluation = evaluate_objects(objects, [by_depth()], protocol=protocol)
    method = evaluation.methods[0]
    tested = dict(zip(evaluation.objects, np.isfinite(method.object_accuracies), strict=True))
    assert tested == {"a_1": True, "a_2": False, "a_3": False, "b_1": False, "b_2": True, "b_3": True}
    assert len(method.fold_accuracies) == 2
    assert evaluation.confusion(method).sum() == sum(
        v.instance in ("a_1", "b_2", "b_3") for v in objects.views
    )
    assert "2 published trials" in object_report(evaluation, {})["protocol"]
    header, rows = object_rows(evaluation)
    assert {row[1] for row in rows if row[header.index("depth")] is None} == {"a_2", "a_3", "b_1"}
    with pytest.raises(DataError, match="trial 1"):
        named_trials(objects.views, [("nobody",)])


class WithoutPairs:
    """Answers with what it was trained on last."""

    name, us_per_pair = "last", float("nan")

    def prepare(self, images, progress=None):
        pass

    def predict(self, train, train_labels, test):
        return np.repeat(train_labels[-1:], len(test))


def test_more_views_than_can_be_compared_in_pairs_are_refused_before_any_is_read(monkeypatch):
    def never_read(view):
        raise AssertionError("read")

    method = by_depth()
    room = int(method.bytes_per_pair * 40**2)
    views = ObjectSet("made", views_of({"a": 3, "b": 4}), never_read, ELEVATIONS, simulated=True)
    monkeypatch.setattr("depthprint.evaluation.objects.machine_bytes", lambda: room)
    with pytest.raises(DataError, match=r"made: 42 views are too many for method 'depth'.* 40 or fewer"):
        evaluate_objects(views, [method])
    with pytest.raises(DataError, match=r"take one view in 3 "):
        require_room_for_pairs("made", [WithoutPairs(), method], 82, room)
    require_room_for_pairs("made", [WithoutPairs(), method], 40, room)
    require_room_for_pairs("made", [WithoutPairs()], 10**9, room)
    require_room_for_pairs("made", [method], 10**9, None)


def test_a_machine_knows_its_memory_or_says_so(monkeypatch):
    import os

    found = machine_bytes()
    assert found is None or found > 1e8
    monkeypatch.delattr(os, "sysconf", raising=False)
    assert machine_bytes() is None


@pytest.mark.parametrize(
    ("name", "least"), [("recogniser", 400), ("emd", 16), ("pixel-l2", 8), ("only-pairs", 400)]
)
def test_methods_that_compare_pairs_say_what_it_takes(name, least):
    from depthprint.objects.methods import make_object_method

    assert make_object_method(name, "object").bytes_per_pair >= least
