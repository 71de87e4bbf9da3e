"""Partly hidden copies of views, and what the recogniser makes of them, on simulated objects."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.objects.fused_recogniser import ViewComparison, fused_comparison
from depthprint.objects.methods import make_object_methods
from depthprint.objects.surface_comparisons import SurfaceComparisons
from depthprint.objects.surface_words import SurfaceWords
from depthprint.partial_views import LEARNED_SHARE, partial_copies
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.simulation.objects import simulated_objects


@pytest.fixture(scope="module")
def crops():
    objects = simulated_objects(n_categories=3, n_instances=2, frames=1, seed=6)
    return [objects.read(view) for view in objects.views]


@pytest.fixture(scope="module")
def words(crops):
    return SurfaceWords.learn(crops[:6], n_words=12, seed=3)


@pytest.fixture(scope="module")
def kernels(words, crops):
    return SurfaceComparisons(words).kernels(crops[:4], mirror=True)


def test_a_copy_keeps_three_quarters_of_its_object(crops):
    for copy, image in zip(partial_copies(crops), crops, strict=True):
        assert copy.mask.sum() == round(image.mask.sum() * (1 - LEARNED_SHARE))
    assert all(
        np.array_equal(a.ranges_m, b.ranges_m, equal_nan=True)
        for a, b in zip(partial_copies(crops), partial_copies(crops), strict=True)
    )


def test_copies_of_one_view_lose_different_parts(crops):
    shapes = {copy.mask.tobytes() for copy in partial_copies([crops[0]] * 4)}
    assert len(shapes) == 4


def test_without_mask_all_that_returned_is_the_object():
    ranges_m = np.full((20, 30), 1.0, dtype=np.float32)
    ranges_m[:, :4] = np.nan
    image = RangeImage(ranges_m, Pinhole(500.0, 500.0, 15.0, 10.0, 30, 20))
    copy = partial_copies([image])[0]
    assert copy.mask is None
    assert copy.valid.sum() == round(image.valid.sum() * (1 - LEARNED_SHARE))


def test_a_view_of_few_pixels_stays_whole():
    mask = np.zeros((8, 8), dtype=bool)
    mask[2:5, 2:6] = True
    image = RangeImage(np.ones((8, 8), dtype=np.float32), Pinhole(500.0, 500.0, 4.0, 4.0, 8, 8), mask=mask)
    assert partial_copies([image])[0] is image
    unseen = image.replace(ranges_m=np.where(mask, np.nan, 1.0).astype(np.float32))
    assert partial_copies([unseen])[0] is unseen


def test_kernels_are_the_products_of_views_mirror_images_and_copies(kernels, words, crops):
    images = crops[:4]
    views, copies = words.features(images), words.features(partial_copies(images))
    for number, (first, second) in enumerate(((views, views), (views, copies), (copies, copies))):
        np.testing.assert_allclose(kernels.straight[number], first[0] @ second[0].T, atol=1e-5)
        crossed = first[0] @ second[1].T
        if number != 1:
            crossed = (crossed + crossed.T) / 2
        np.testing.assert_allclose(kernels.crossed[number], crossed, atol=1e-5)
    rows = np.arange(4)
    sums = np.concatenate([views[0] + views[1], copies[0] + copies[1]])
    sums /= np.linalg.norm(sums, axis=1, keepdims=True)
    found = kernels.summed(rows, rows, among=True, copies=(0, 1))
    np.testing.assert_allclose(found, sums @ sums.T, atol=1e-5)
    np.testing.assert_array_equal(kernels.summed(rows, rows), found[:4, :4])


def test_kernels_without_size_are_those_of_the_other_kinds(words, crops):
    comparisons = SurfaceComparisons(words)
    kinds = [words.only(kind).features(crops[:4])[0] for kind in words.vocabularies if kind != "size"]
    found = comparisons.kernels(crops[:4], mirror=True, sized=False)
    np.testing.assert_allclose(found.straight[0], np.mean([k @ k.T for k in kinds], axis=0), atol=1e-5)
    unturned = comparisons.kernels(crops[:4], mirror=False)
    np.testing.assert_array_equal(unturned.crossed, unturned.straight)


def test_copies_follow_the_views_that_they_are_of(kernels):
    rows = np.array([0, 2, 3])
    for compared in (kernels.summed, kernels.nearer):
        among = compared(rows, rows, among=True, copies=(0, 1))
        assert among.shape == (6, 6)
        np.testing.assert_allclose(among, among.T, atol=1e-6)
        # A training view as a query compares as it does among the training views.
        np.testing.assert_allclose(compared(rows, rows, copies=(0, 1)), among[:3], atol=1e-6)
        np.testing.assert_allclose(compared(rows, rows, among=True), among[:3, :3], atol=1e-6)
    asked = kernels.nearer(np.array([1]), rows, copies=(0, 1))
    nearest = np.maximum(kernels.straight[1, 1, rows], kernels.crossed[1, 1, rows])
    np.testing.assert_allclose(asked[0, 3:], 1.0 - nearest, atol=1e-6)


def test_machine_kernel_has_views_and_their_mirror_images(kernels):
    rows = np.array([0, 2, 3])
    among = kernels.with_mirrored(rows, rows, among=True)
    assert among.shape == (6, 6)
    np.testing.assert_array_equal(among, among.T)
    np.testing.assert_array_equal(kernels.with_mirrored(rows, rows), among[:3])


def test_a_part_without_copies_counts_them_as_their_views():
    known = ViewComparison(np.eye(2))
    with_copies = ViewComparison(np.arange(16.0).reshape(4, 4))
    fused = fused_comparison([known, with_copies], [1.0, 3.0])
    np.testing.assert_allclose(fused.kernel, (np.tile(np.eye(2), (2, 2)) + 3 * with_copies.kernel) / 4)
    asked = fused_comparison([ViewComparison(np.ones((3, 2))), ViewComparison(np.zeros((3, 4)))], [1.0, 1.0])
    np.testing.assert_array_equal(asked.kernel, np.full((3, 4), 0.5))


def test_the_row_without_partial_copies_does_not_depend_on_them(crops, monkeypatch):
    labels = np.repeat(np.arange(3), len(crops) // 3)
    test = np.arange(0, len(crops), 3)
    train = np.setdiff1d(np.arange(len(crops)), test)

    def scores():
        found = []
        for method in make_object_methods(["no-geometry", "no-partial"]):
            method.prepare(crops)
            found.append(method.scores(train, labels[train], test)[0])
        return found

    learned, plain = scores()
    monkeypatch.setattr("depthprint.objects.surface_comparisons.partial_copies", list)
    same, unchanged = scores()
    np.testing.assert_array_equal(plain, unchanged)
    assert np.abs(learned - same).max() > 0.01
