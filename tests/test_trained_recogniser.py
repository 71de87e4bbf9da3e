"""The recogniser that users train and save, on simulated objects."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from depthprint.encoder import load_shipped_encoder
from depthprint.errors import DataError, ModelError
from depthprint.io.archive import read_archive, write_archive
from depthprint.objects.calibration import Calibration, calibrate
from depthprint.objects.class_directions import ClassDirections
from depthprint.objects.discriminant import KernelDiscriminant
from depthprint.objects.fused_recogniser import SHRINKAGE, FusedRecogniser
from depthprint.objects.leading_directions import LeadingDirections
from depthprint.objects.learned_classes import LearnedClasses
from depthprint.objects.methods import make_object_method
from depthprint.objects.recogniser_file import FORMAT, FORMAT_VERSION
from depthprint.objects.stored_views import store_views
from depthprint.objects.surface_words import SurfaceWords
from depthprint.objects.trained_recogniser import TrainedRecogniser
from depthprint.partial_views import partial_copies
from depthprint.projection import Spherical
from depthprint.range_image import RangeImage
from depthprint.simulation.objects import simulated_objects
from depthprint.surflet_pairs import pair_vectors

N_CATEGORIES = 5


@pytest.fixture(scope="module")
def views():
    objects = simulated_objects(n_categories=N_CATEGORIES, n_instances=3, frames=1, seed=8)
    return [(view, objects.read(view)) for view in objects.views]


@pytest.fixture(scope="module")
def recogniser(views):
    stored = [(v, image) for v, image in views if not v.instance.endswith("_3") and v.category != "shape05"]
    return TrainedRecogniser.fit(
        load_shipped_encoder("object"),
        [image for _, image in stored],
        [v.category for v, _ in stored],
        groups=[v.instance for v, _ in stored],
        sources=[v.path for v, _ in stored],
    )


def queries(views, category=None):
    return [
        (v, image)
        for v, image in views
        if v.instance.endswith("_3")
        and (v.category != "shape05" if category is None else v.category == category)
    ]


def test_objects_never_seen_are_put_in_their_class(recogniser, views):
    asked = queries(views)
    found = [recogniser.recognise(image) for _, image in asked]
    assert np.mean([f.classes[0][0] == v.category for f, (v, _) in zip(found, asked, strict=True)]) >= 0.75


def test_probabilities_add_up_and_are_sorted(recogniser, views):
    found = recogniser.recognise(queries(views)[0][1])
    shares = [share for _, share in found.classes]
    assert sum(shares) + found.none_probability == pytest.approx(1.0)
    assert shares == sorted(shares, reverse=True)
    assert {label for label, _ in found.classes} == set(recogniser.labels)
    assert found.nearest in recogniser.sources


@pytest.mark.parametrize("n_threads", [1, 2, 3])
def test_answers_are_the_same_to_the_bit_on_any_threads(recogniser, views, monkeypatch, n_threads):
    asked = [image for _, image in queries(views)]
    known = [
        recogniser.stored.describe(recogniser.encoder, [recogniser.encoder.describe(i)], [i]) for i in asked
    ]
    expected = [recogniser.recognise(image) for image in asked]
    monkeypatch.setattr("numba.get_num_threads", lambda: n_threads)
    with ThreadPoolExecutor(4) as callers:
        assert list(callers.map(recogniser.recognise, asked * 4)) == expected * 4
        found = list(
            callers.map(lambda i: recogniser.stored.encode_and_describe(recogniser.encoder, [i]), asked)
        )
    for (one, _), other in zip(found, known, strict=True):
        for name in ("straight", "mirrored", "landmark", "surface", "mirrored_surface", "pairs"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_an_image_that_cannot_be_encoded_is_refused_on_two_threads(recogniser, views, monkeypatch):
    monkeypatch.setattr("numba.get_num_threads", lambda: 2)
    image = queries(views)[0][1]
    with pytest.raises(DataError, match="nowhere"):
        recogniser.recognise(image.replace(ranges_m=np.zeros_like(image.ranges_m), source="nowhere"))


def test_an_unknown_kind_is_less_known_than_the_known_ones(recogniser, views):
    known = [recogniser.recognise(image).none_probability for _, image in queries(views)]
    unknown = [recogniser.recognise(image).none_probability for _, image in queries(views, "shape05")]
    assert np.mean(unknown) > np.mean(known)


def test_several_views_of_one_object_are_one_query(recogniser, views):
    turn = [image for v, image in queries(views) if v.category == "shape01"]
    assert len(turn) == 3
    together = recogniser.predict([turn, turn[0]])
    assert len(together) == 2
    one = recogniser.recognise([turn[0], turn[0]])
    assert one.classes[0] == pytest.approx(recogniser.recognise(turn[0]).classes[0])


def test_a_saved_recogniser_answers_the_same(recogniser, views, tmp_path):
    path = recogniser.save(tmp_path / "mine")
    assert path.name == "mine.npz"
    loaded = TrainedRecogniser.load(path)
    image = queries(views)[1][1]
    first, second = recogniser.recognise(image), loaded.recognise(image)
    assert first == second
    assert loaded.view_labels == recogniser.view_labels


def test_what_a_saved_recogniser_aligns_queries_with_is_what_was_kept(recogniser, tmp_path):
    kept = recogniser.stored.geometry
    loaded = TrainedRecogniser.load(recogniser.save(tmp_path / "mine")).stored.geometry
    assert len(kept) == len(recogniser.sources)
    for name in ("depths", "objects", "steps_m", "shapes", "lenses"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(kept, name))
    with pytest.raises(DataError, match=r"geometry of \d+ views, got 2"):
        replace(recogniser.stored, geometry=kept.taken(np.arange(2)))


def test_the_alignment_of_objects_moves_scores_and_scenes_have_none(recogniser, views, monkeypatch):
    image = queries(views)[0][1]
    before = recogniser.recognise(image)
    monkeypatch.setattr(
        "depthprint.objects.trained_recogniser.aligned_agreements",
        lambda query, stored: np.zeros(len(stored)),
    )
    assert recogniser.recognise(image).classes != before.classes
    crops = [image for _, image in views[:6]]
    scenes = TrainedRecogniser.fit(load_shipped_encoder("handheld"), crops, ["a"] * 3 + ["b"] * 3)
    assert scenes.stored.geometry is None
    assert scenes.recognise(crops[0]).classes[0][0] == "a"


def test_a_file_holds_what_was_learned_so_that_loading_learns_nothing(recogniser, tmp_path, monkeypatch):
    path = recogniser.save(tmp_path / "mine")
    monkeypatch.setattr(LearnedClasses, "fit", None)
    loaded = TrainedRecogniser.load(path)
    for name, array in recogniser.learned.parts().items():
        np.testing.assert_array_equal(loaded.learned.parts()[name], array)
    assert len(recogniser.learned.joined.scales) == 3
    header, arrays = read_archive(path, "recogniser", FORMAT, FORMAT_VERSION)
    for name, broken in (
        ("class_codes", arrays["class_codes"][:, 1:]),
        ("neighbour_scales_1", -arrays["neighbour_scales_1"] - 1),
        ("neighbour_scales_0", arrays["neighbour_scales_0"][1:]),
        ("nearest_weights", arrays["nearest_weights"][1:]),
    ):
        write_archive(tmp_path / "broken.npz", header, arrays | {name: broken})
        with pytest.raises(ModelError, match=r"broken\.npz: expected a whole recogniser file"):
            TrainedRecogniser.load(tmp_path / "broken.npz")


def test_a_damaged_or_another_file_is_refused(recogniser, tmp_path):
    path = recogniser.save(tmp_path / "mine")
    content = path.read_bytes()
    (tmp_path / "short.npz").write_bytes(content[: len(content) // 2])
    with pytest.raises(ModelError, match=r"short\.npz"):
        TrainedRecogniser.load(tmp_path / "short.npz")
    model = recogniser.encoder.save(tmp_path / "encoder")
    with pytest.raises(ModelError, match=r"encoder\.npz.*recogniser"):
        TrainedRecogniser.load(model)


def test_a_file_of_the_version_before_is_refused(recogniser, tmp_path):
    header, arrays = read_archive(recogniser.save(tmp_path / "mine"), "recogniser", FORMAT, FORMAT_VERSION)
    write_archive(tmp_path / "old.npz", header | {"version": FORMAT_VERSION - 1}, arrays)
    with pytest.raises(
        ModelError, match=rf"old\.npz: .* version {FORMAT_VERSION}, got .* {FORMAT_VERSION - 1}"
    ):
        TrainedRecogniser.load(tmp_path / "old.npz")


def test_partial_copies_of_the_views_are_learned_from(recogniser):
    stored = recogniser.stored.views
    # Copies are near the views that they are of, and not the same.
    alike = (stored.surface * stored.partial).sum(axis=1)
    assert alike.max() < 0.999
    across = stored.surface @ stored.partial.T
    assert np.mean(across.argmax(axis=1) == np.arange(len(stored))) > 0.5
    some = stored.taken(np.array([1, 3]))
    np.testing.assert_array_equal(some.mirrored_partial, stored.mirrored_partial[[1, 3]])
    np.testing.assert_array_equal(some.partial_pairs, stored.partial_pairs[[1, 3]])
    assert some.compared_with(some).kernel.shape == (4, 4)
    found = some.compared_with(stored)
    assert found.kernel.shape == (2, 2 * len(stored))
    widths = [distances.shape[1] for distances in found.distances]
    assert widths == [len(stored), 2 * len(stored), 2 * len(stored)]


@pytest.mark.parametrize("n_queries", [1, 8])
def test_class_directions_give_the_scores_of_all_kernel_values(recogniser, views, n_queries):
    images = [image for _, image in queries(views)][:n_queries]
    stored = recogniser.stored.views
    fused = FusedRecogniser(nearest_weights=recogniser.learned.joined.weights)
    fused.fit(stored.compared_with(stored), recogniser.view_labels)
    asked, _ = recogniser.stored.encode_and_describe(recogniser.encoder, images)
    expected = asked.compared_with(stored)
    found = ClassDirections.of(stored, fused).scores(asked)
    np.testing.assert_allclose(found[0], fused._discriminant.scores(expected.kernel), rtol=0, atol=1e-4)
    np.testing.assert_allclose(found[1], expected.machine_kernel @ fused.multipliers, rtol=0, atol=1e-4)
    near = asked.distances_to(stored)
    np.testing.assert_allclose(
        recogniser.learned.scores(asked, near), fused.scores(expected), rtol=0, atol=1e-3
    )
    # One query is multiplied by a kernel of our own, several by BLAS: both give one minus the greater cosine.
    of_views = (
        ("straight", "mirrored", None),
        ("surface", "mirrored_surface", "partial"),
        ("pairs", "pairs", "partial_pairs"),
    )
    for distances, (straight, mirrored, partial) in zip(near, of_views, strict=True):
        known = [getattr(stored, name) for name in (straight, partial) if name is not None]
        cosines = [getattr(asked, side) @ np.concatenate(known).T for side in (straight, mirrored)]
        np.testing.assert_allclose(distances, np.maximum(1 - np.maximum(*cosines), 0), rtol=0, atol=1e-6)


def test_class_directions_of_places_have_no_surfaces(views):
    crops = [image for _, image in views[:6]]
    scenes = TrainedRecogniser.fit(load_shipped_encoder("handheld"), crops, ["a"] * 3 + ["b"] * 3)
    directions = scenes.learned.directions
    assert directions.surfaces is directions.pairs is directions.machine is None
    among = scenes.stored.views.compared_with(scenes.stored.views)
    expected = KernelDiscriminant(SHRINKAGE).fit(among.kernel, scenes.view_labels).scores(among.kernel)
    scores, machine = directions.scores(scenes.stored.views)
    assert machine is None
    np.testing.assert_allclose(scores, expected, rtol=0, atol=1e-4)


def test_what_cannot_be_learned_from_is_refused(views):
    encoder = load_shipped_encoder("object")
    images = [image for _, image in views[:3]]
    with pytest.raises(DataError, match="two classes"):
        TrainedRecogniser.fit(encoder, images, ["a", "a", "a"])
    with pytest.raises(DataError, match="3 views, got 2"):
        TrainedRecogniser.fit(encoder, images, ["a", "b"])


def test_no_view_is_no_query(recogniser):
    with pytest.raises(DataError, match="got none"):
        recogniser.recognise([])


def noisy_scorer(noise):
    """Scores of one-dimensional views by their distance to class means."""

    def scorer(positions):
        def score(train, labels, test):
            classes = np.unique(labels)
            means = np.array([positions[train][labels == c].mean() for c in classes])
            gaps = np.abs(positions[test][:, None] - means)
            nearest = np.abs(positions[test][:, None] - positions[train]).min(axis=1)
            return -gaps / noise, nearest

        return score

    return scorer


def test_confidence_is_the_share_of_right_answers():
    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(6), 40)
    positions = labels * 1.0 + rng.normal(0, 0.5, len(labels))
    groups = np.arange(len(labels)) // 4
    score = noisy_scorer(0.05)(positions)
    calibration = calibrate(score, labels, groups, 0)
    fresh = np.repeat(np.arange(6), 200)
    asked = fresh + rng.normal(0, 0.5, len(fresh))
    scores = -np.abs(asked[:, None] - np.arange(6)) / 0.05
    plain = Calibration(calibration.temperature, None)
    confidence = np.array([plain.probabilities(s, 0.0)[0].max() for s in scores])
    right = scores.argmax(1) == fresh
    assert abs(confidence.mean() - right.mean()) < 0.1
    # Without calibration the same scores claim far too much.
    sure = np.array([Calibration(1.0, None).probabilities(s, 0.0)[0].max() for s in scores])
    assert abs(sure.mean() - right.mean()) > 0.15


def test_two_classes_are_too_few_to_learn_the_unknown():
    labels = np.repeat([0, 1], 8)
    positions = labels + np.random.default_rng(0).normal(0, 0.1, 16)
    calibration = calibrate(noisy_scorer(0.1)(positions), labels, np.arange(16), 0)
    assert calibration.novelty is None
    assert calibration.probabilities(np.array([1.0, 0.0]), 9.0)[1] == 0.0


def test_many_views_are_learned_from_without_all_pairs_and_answer_alike(recogniser, views, monkeypatch):
    kept = recogniser.stored.views
    monkeypatch.setattr("depthprint.objects.learned_classes.MOST_IN_PAIRS", 0)
    monkeypatch.setattr("depthprint.objects.view_features._BLOCK_ROWS", 7)
    many = LearnedClasses.fit(kept, recogniser.view_labels)
    for alone, among in zip(many.joined.scales, recogniser.learned.joined.scales, strict=True):
        np.testing.assert_allclose(alone, among, rtol=0, atol=1e-6)
    asked, _ = recogniser.stored.encode_and_describe(
        recogniser.encoder, [image for _, image in queries(views)]
    )
    found, expected = many.directions.scores(asked), recogniser.learned.directions.scores(asked)
    np.testing.assert_allclose(found[0], expected[0], rtol=0, atol=1e-3 * expected[0].std())
    # The machine of pairs stops short of its optimum.
    assert np.corrcoef(found[1].ravel(), expected[1].ravel())[0, 1] > 0.99
    near = asked.distances_to(kept)
    labels = [learned.scores(asked, near).argmax(axis=1) for learned in (many, recogniser.learned)]
    np.testing.assert_array_equal(*labels)


def test_views_are_described_in_blocks_where_there_are_many(views, monkeypatch):
    encoder = load_shipped_encoder("object")
    images = [image for _, image in views[:11]]
    encodings = encoder.describe_many(images)
    words = SurfaceWords.load()
    monkeypatch.setattr("depthprint.objects.stored_views.DESCRIBED_AT_ONCE", 4)
    kept = store_views(encoder, encodings, images, 0, words)
    of_views, of_copies = (words.features(of) for of in (images, partial_copies(images)))
    chosen = [0, 3, 6, 10]
    vectors = np.concatenate([side[chosen] for side in (*of_views, *of_copies)])
    directions = LeadingDirections.of(vectors, 0)
    np.testing.assert_allclose(kept.surface_directions.matrix(), directions.matrix(), rtol=0, atol=1e-3)
    expected = kept.surface_directions.along([*of_views, *of_copies])
    found = (getattr(kept.views, n) for n in ("surface", "mirrored_surface", "partial", "mirrored_partial"))
    for some, all_ in zip(found, expected, strict=True):
        np.testing.assert_allclose(some, all_, rtol=0, atol=1e-5)
    expected = kept.pair_directions.along([pair_vectors(of) for of in (images, partial_copies(images))])
    for some, all_ in zip((kept.views.pairs, kept.views.partial_pairs), expected, strict=True):
        np.testing.assert_allclose(some, all_, rtol=0, atol=1e-5)


def test_the_saved_recogniser_is_a_method_of_the_table(views):
    method = make_object_method("recogniser-saved", "object")
    with pytest.raises(DataError, match="prepare"):
        method.scores(np.arange(2), np.arange(2), np.arange(2))
    method.prepare([image for _, image in views])
    numbers = np.array([int(v.category.removeprefix("shape")) for v, _ in views])
    third = np.array([v.instance.endswith("_3") for v, _ in views])
    train, test = np.flatnonzero(~third), np.flatnonzero(third)
    scores, labels = method.scores(train, numbers[train], test)
    assert scores.shape == (len(test), len(labels))
    found = method.predict(train, numbers[train], test)
    np.testing.assert_array_equal(found, labels[scores.argmax(axis=1)])
    assert np.mean(found == numbers[test]) >= 0.75


def test_views_other_than_pinhole_are_known_by_their_codes_alone():
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[:64, :64]
    shapes = {"step": np.where(columns < 32, 2.0, 2.4), "ramp": 2.0 + 0.01 * rows}
    labels = [name for name in shapes for _ in range(4)]
    views = [
        RangeImage((shapes[name] + 0.002 * rng.normal(size=(64, 64))).astype(np.float32), Spherical(64, 64))
        for name in labels
    ]
    recogniser = TrainedRecogniser.fit(load_shipped_encoder("object"), views[1:], labels[1:])
    assert [stream.view for stream in recogniser.encoder.settings.streams] == ["normals", "depth"]
    assert recogniser.recognise(views[0]).classes[0][0] == "step"
    method = make_object_method("recogniser-saved")
    method.prepare(views)
    known = np.array([name == "step" for name in labels], dtype=np.int64)
    assert method.predict(np.arange(1, len(views)), known[1:], np.arange(1)).tolist() == [1]
