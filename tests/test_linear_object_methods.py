"""Linear methods for objects: on simulated objects, and on cad51 (simulated too) where it is."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.baselines.kernel_descriptors.estimators import kernel_descriptor_classifier
from depthprint.baselines.kernel_descriptors.kinds import KINDS
from depthprint.baselines.kernel_descriptors.match_features import power_transform
from depthprint.baselines.kernel_descriptors.patch_grid import mirrored_image
from depthprint.baselines.sparse_pyramid import sparse_pyramid_features
from depthprint.datasets.uw_rgbd_object import cad51
from depthprint.encoder import Encoder, load_shipped_encoder
from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.objects import category_folds
from depthprint.objects.linear_methods import KernelDescriptorViews, LinearSvmMethod
from depthprint.objects.methods import OBJECT_METHODS, make_object_method, make_object_methods
from depthprint.simulation.objects import simulated_objects

# The kinds one by one are parts of "all".
LINEAR = ["kdes-all", "kdes-gradient-aided", "kdes-lbp-aided", "hog-svm", "sparse-pyramid-svm", "codes-svm"]


@pytest.fixture(scope="module")
def crops():
    objects = simulated_objects(n_categories=3, n_instances=2, frames=1, seed=5)
    categories = np.array([view.category for view in objects.views])
    return [objects.read(view) for view in objects.views], np.unique(categories, return_inverse=True)[1]


@pytest.mark.parametrize("name", LINEAR)
def test_categories_are_named_better_than_by_chance(name, crops):
    if name == "hog-svm":
        pytest.importorskip("skimage")
    images, labels = crops
    method = make_object_method(name)
    counted = []
    method.prepare(images, lambda done, total: counted.append((done, total)))
    numbers = np.arange(len(images))
    test = numbers[::4]
    train = np.setdiff1d(numbers, test)
    predicted = method.predict(train, labels[train], test)
    scores, columns = method.scores(train, labels[train], test)
    assert np.mean(predicted == labels[test]) > 0.5
    assert scores.shape == (len(test), 3)
    np.testing.assert_array_equal(columns[scores.argmax(1)], predicted)
    assert np.isnan(method.us_per_pair)
    assert counted[-1][0] == counted[-1][1] >= len(images)


def test_every_kind_is_registered_plain_and_aided():
    for kind in [*KINDS, "all"]:
        for name in (f"kdes-{kind}", f"kdes-{kind}-aided"):
            assert OBJECT_METHODS[name] is OBJECT_METHODS["kdes-all"]
            assert make_object_method(name).name == name


def test_words_come_from_training_views_alone(crops):
    images, labels = crops
    train = np.arange(0, 14)
    margins = []
    for last in (images[14:], [im.replace(ranges_m=im.ranges_m * 1.5) for im in images[14:]]):
        method = LinearSvmMethod("size", KernelDescriptorViews(("size",), n_words=50), C=10.0)
        method.prepare([*images[:14], *last])
        margins.append(method.scores(train, labels[train], train)[0])
    np.testing.assert_array_equal(*margins)


def test_all_four_are_the_four_side_by_side(crops):
    images, _ = crops
    train, test = np.arange(6), np.arange(6, 9)
    together = KernelDescriptorViews(tuple(KINDS), n_words=20)
    together.prepare(images[:9])
    blocks = list(together.blocks(train, test))
    assert [known.shape for known, _ in blocks] == [(6, 280)] * 4
    alone = KernelDescriptorViews(("spin",), n_words=20)
    alone.prepare(images[:9])
    for expected, found in zip(next(alone.blocks(train, test)), blocks[2], strict=True):
        np.testing.assert_array_equal(found, expected)


def test_the_pipeline_gives_the_margins_of_the_method(crops):
    images, labels = crops
    test = np.arange(0, 18, 3)
    train = np.setdiff1d(np.arange(18), test)
    method = LinearSvmMethod("both", KernelDescriptorViews(("gradient", "size"), n_words=30), C=10.0)
    method.prepare(images)
    expected, _ = method.scores(train, labels[train], test)
    pipeline = kernel_descriptor_classifier(("gradient", "size"), n_words=30)
    pipeline.fit([images[n] for n in train], labels[train])
    np.testing.assert_allclose(pipeline.decision_function([images[n] for n in test]), expected, atol=0.02)
    with pytest.raises(SettingsError, match="'colour'"):
        kernel_descriptor_classifier(("colour",))


def test_mirrored_views_train_too(crops):
    images, _ = crops
    features = KernelDescriptorViews(("gradient",), mirror=True, n_words=30)
    features.prepare(images[:12])
    ((known, asked),) = features.blocks(np.arange(8), np.arange(8, 12))
    assert (len(known), len(asked)) == (16, 4)
    assert not np.allclose(known[:8], known[8:])


def test_power_keeps_the_sign():
    np.testing.assert_allclose(power_transform(np.float32([-1024.0, 0.0, 1.0])), [-8.0, 0.0, 1.0], rtol=1e-6)


def test_pyramid_vectors_are_units_and_mirrored_where_the_encoder_mirrors(crops):
    images, _ = crops
    encoder = load_shipped_encoder("object")
    straight, mirrored = sparse_pyramid_features(encoder, images[:2])
    again, _ = sparse_pyramid_features(encoder, [mirrored_image(images[0])])
    np.testing.assert_allclose(np.linalg.norm(straight, axis=1), 1.0, rtol=1e-5)
    # Not equal: a hole between two equally near pixels is filled from the first of them.
    assert again[0] @ mirrored[0] > 0.8
    assert again[0] @ mirrored[0] > again[0] @ straight[0]
    plain = Encoder(encoder.settings.model_copy(update={"mirror": False}), encoder.streams)
    assert sparse_pyramid_features(plain, images[:1])[1] is None
    with pytest.raises(SettingsError, match="literal"):
        sparse_pyramid_features(load_shipped_encoder("literal"), images[:1])


def test_using_a_method_before_prepare_is_an_error():
    for name in ("kdes-size", "sparse-pyramid-svm"):
        with pytest.raises(DataError, match="prepare"):
            make_object_method(name).predict(np.arange(2), np.arange(2), np.arange(2))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "least"), [("kdes-spin", 0.6), ("hog-svm", 0.4)])
def test_cad51_categories_are_learned(data_root, name, least):
    if name == "hog-svm":
        pytest.importorskip("skimage")
    objects = cad51(data_root / "objects" / "cad51", frames=(1,))
    kept = ("Cup", "Guitar", "Wheel", "Shelf")
    views = [view for view in objects.views if view.category in kept]
    labels = np.array([kept.index(view.category) for view in views])
    train, test = category_folds(views, 0)[0]
    method = make_object_method(name)
    method.prepare([objects.read(view) for view in views])
    assert np.mean(method.predict(train, labels[train], test) == labels[test]) > least


def test_rows_of_kernel_descriptors_describe_views_once_and_agree_with_rows_alone(crops, monkeypatch):
    from depthprint.baselines.kernel_descriptors import described_views

    images, labels = crops
    described = []
    original = described_views.describe_crops

    def counted(images, kind, **options):
        described.append((kind, options["masked"], len(images)))
        return original(images, kind, **options)

    monkeypatch.setattr(described_views, "describe_crops", counted)
    test = np.arange(0, 18, 3)
    train = np.setdiff1d(np.arange(18), test)
    rows = make_object_methods(["kdes-size", "kdes-all", "kdes-size-aided"])
    for method in rows:
        method.prepare(images)
    assert sorted(described) == sorted([(kind, False, 18) for kind in KINDS] + [("size", True, 18)])
    together = [method.scores(train, labels[train], test)[0] for method in rows]
    alone = make_object_method("kdes-all")
    alone.prepare(images)
    np.testing.assert_array_equal(together[1], alone.scores(train, labels[train], test)[0])
    assert not np.array_equal(together[0], together[2])
