"""Surface words on simulated objects: vectors of views that depend on nothing but the view."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.baselines.kernel_descriptors.kinds import KINDS, describe_crops
from depthprint.baselines.kernel_descriptors.match_features import PYRAMID
from depthprint.baselines.kernel_descriptors.patch_grid import mirrored_image
from depthprint.errors import ModelError, SettingsError
from depthprint.objects.surface_words import SHIPPED, SurfaceWords
from depthprint.simulation.objects import simulated_objects


@pytest.fixture(scope="module")
def crops():
    objects = simulated_objects(n_categories=4, n_instances=2, frames=1, seed=6)
    return [objects.read(view) for view in objects.views]


@pytest.fixture(scope="module")
def words(crops):
    return SurfaceWords.learn(crops[:12], n_words=16, seed=3)


def test_vectors_are_units_and_each_kind_has_an_equal_share(words, crops):
    rows = words.features(crops[:5])[0]
    assert rows.shape == (5, 4 * 16 * sum(n * n for n in PYRAMID))
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1.0, rtol=1e-5)
    shares = np.linalg.norm(rows.reshape(5, len(KINDS), -1), axis=2)
    np.testing.assert_allclose(shares, 0.5, rtol=1e-5)


def test_the_kernel_of_all_kinds_is_the_mean_of_theirs(words, crops):
    rows = words.features(crops[:6])[0]
    each = [words.only(kind).features(crops[:6])[0] for kind in KINDS]
    np.testing.assert_allclose(rows @ rows.T, sum(r @ r.T for r in each) / len(KINDS), atol=1e-5)
    with pytest.raises(SettingsError, match="'colour'"):
        words.only("colour")


def test_mirrored_vectors_are_those_of_the_mirror_image(words, crops):
    turned = [mirrored_image(image) for image in crops[:6]]
    straight, mirrored = words.features(crops[:6])
    again, back = words.features(turned)
    assert ((mirrored * again).sum(1) > 0.9).all()
    assert ((straight * back).sum(1) > (straight * again).sum(1)).all()
    whole, same = words.features(crops[:2], mirror=False)
    assert same is whole


@pytest.mark.parametrize("kind", KINDS)
def test_shipped_words_are_in_the_basis_that_this_machine_makes(crops, kind):
    words = SurfaceWords.load().vocabularies[kind].words
    found = np.concatenate([crop.vectors for crop in describe_crops(crops, kind, masked=True)]).astype(
        np.float64
    )
    lengths = np.linalg.norm(found, axis=1)
    found = found[lengths > 0.1 * lengths.max()]
    turned = found * np.random.default_rng(1).choice([-1.0, 1.0], found.shape[1])
    apart, turned_apart = (np.linalg.norm(v[:, None] - words, axis=2).min(1) for v in (found, turned))
    assert np.mean(apart < turned_apart) > 0.95


def test_vectors_of_a_view_do_not_depend_on_the_others(words, crops):
    np.testing.assert_allclose(words.features(crops[3:5])[0], words.features(crops)[0][3:5], atol=1e-6)


def test_what_lies_around_the_object_does_not_count(words, crops):
    image = crops[0]
    moved = image.replace(ranges_m=np.where(image.mask, image.ranges_m, image.ranges_m + 0.1))
    np.testing.assert_allclose(words.features([moved])[0], words.features([image])[0], atol=1e-6)


def test_an_object_too_small_for_a_kind_has_a_vector_all_the_same(words, crops):
    image = crops[0]
    rows, columns = np.nonzero(image.mask)
    sliver = np.zeros_like(image.mask)
    sliver[rows.min() : rows.min() + 3, columns[rows.argmin()]] = True
    known = np.where(sliver, 1.0, np.nan)
    thin = image.replace(ranges_m=known, mask=sliver)
    assert len(describe_crops([thin], "spin", masked=True)[0].vectors) == 0
    assert np.linalg.norm(words.features([thin])[0][0]) == pytest.approx(1.0, rel=1e-5)


def test_saved_words_give_the_same_vectors(words, crops, tmp_path):
    loaded = SurfaceWords.load(words.save(tmp_path / "words.npz"))
    np.testing.assert_array_equal(loaded.features(crops[:2])[0], words.features(crops[:2])[0])


def test_a_damaged_file_is_named(tmp_path):
    path = tmp_path / "words.npz"
    path.write_bytes(SHIPPED.read_bytes()[:-200])
    with pytest.raises(ModelError, match=r"words\.npz"):
        SurfaceWords.load(path)
    with pytest.raises(ModelError, match=r"nowhere\.npz"):
        SurfaceWords.load(tmp_path / "nowhere.npz")


def test_shipped_words_tell_simulated_objects_apart(crops):
    rows = SurfaceWords.load().features(crops)[0]
    kernel = rows @ rows.T
    kinds = np.arange(len(crops)) // 6
    np.fill_diagonal(kernel, -1.0)
    assert np.mean(kinds[kernel.argmax(1)] == kinds) > 0.6
