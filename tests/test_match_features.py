"""Match features: vocabulary, whitening and pyramid, by hand on little input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.baselines.kernel_descriptors.match_features import (
    PYRAMID,
    Vocabulary,
    learn_vocabulary,
    match_features,
)
from depthprint.baselines.kernel_descriptors.patch_grid import PatchDescriptors
from depthprint.errors import DataError, SettingsError


def descriptors(vectors, positions):
    return PatchDescriptors(
        np.array(vectors, dtype=np.float32).reshape(len(positions), -1),
        np.array(positions, dtype=np.float32).reshape(-1, 2),
    )


def random_crop(generator, n, dims=5):
    return PatchDescriptors(
        generator.normal(size=(n, dims)).astype(np.float32), generator.random((n, 2)).astype(np.float32)
    )


def direct_features(crop, vocabulary):
    """Cell by cell, word by word, descriptor by descriptor."""
    level_weight = {n: (1 / n**2) / sum(1 / m**2 for m in PYRAMID) for n in PYRAMID}
    cells = []
    for n in PYRAMID:
        for row in range(n):
            for column in range(n):
                best: dict[int, tuple[float, np.ndarray]] = {}
                for vector, (x, y) in zip(crop.vectors, crop.positions, strict=True):
                    if (min(int(x * n), n - 1), min(int(y * n), n - 1)) != (column, row):
                        continue
                    response = np.exp(-vocabulary.gamma * ((vector - vocabulary.words) ** 2).sum(1))
                    word = int(response.argmax())
                    if word not in best or response[word] > best[word][0]:
                        best[word] = (response[word], response)
                mean = np.zeros(len(vocabulary.words))
                if best:
                    mean = np.mean([response for _, response in best.values()], axis=0)
                cells.append(level_weight[n] * (vocabulary.whitening @ mean))
    return np.concatenate(cells)


def test_one_descriptor_on_a_word_fills_the_cells_that_it_lies_in():
    vocabulary = Vocabulary.of([[0.0], [30.0]], gamma=1.0)
    features = match_features([descriptors([[30.0]], [[0.9, 0.1]])], vocabulary)[0].reshape(14, 2)
    # The words do not respond to each other: G is the identity, but for the ridge.
    expected = np.zeros((14, 2))
    weights = np.array([1, 1 / 4, 1 / 9]) / (1 + 1 / 4 + 1 / 9)
    expected[0, 1], expected[1 + 1, 1], expected[1 + 4 + 2, 1] = weights
    np.testing.assert_allclose(features, expected, atol=1e-5)


def test_a_word_keeps_only_the_descriptor_that_responds_most():
    vocabulary = Vocabulary.of([[0.0], [30.0]], gamma=1.0)
    place = [0.5, 0.5]
    near, far, other = [0.1], [0.9], [30.0]
    both = match_features([descriptors([far, near, other], [place] * 3)], vocabulary)
    one = match_features([descriptors([near, other], [place] * 2)], vocabulary)
    np.testing.assert_allclose(both, one)
    assert not np.allclose(one, match_features([descriptors([far, other], [place] * 2)], vocabulary))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(0, 25), words=st.integers(1, 8))
def test_features_equal_their_definition(seed, n, words):
    generator = np.random.default_rng(seed)
    vocabulary = Vocabulary.of(generator.normal(size=(words, 5)), gamma=0.1)
    crop = random_crop(generator, n)
    found = match_features([crop, random_crop(generator, 3)], vocabulary)
    assert found.dtype == np.float32
    assert found.shape == (2, vocabulary.n_features)
    np.testing.assert_allclose(found[0], direct_features(crop, vocabulary), atol=1e-4)


def test_whitening_is_the_upper_factor_of_the_inverse():
    words = np.random.default_rng(0).normal(size=(12, 4))
    vocabulary = Vocabulary.of(words, gamma=0.7)
    kernel = np.exp(-0.7 * ((words[:, None] - words) ** 2).sum(-1)) + 1e-6 * np.eye(12)
    factor = np.linalg.cholesky(np.linalg.inv(kernel)).T
    np.testing.assert_allclose(vocabulary.whitening, factor, rtol=1e-6, atol=1e-8)


def test_whitening_survives_words_that_all_respond_alike():
    words = np.random.default_rng(1).normal(size=(300, 6))
    g = Vocabulary.of(words, gamma=0.001).whitening
    kernel = np.exp(-0.001 * ((words[:, None] - words) ** 2).sum(-1)) + 1e-6 * np.eye(300)
    assert np.array_equal(g, np.triu(g))
    np.testing.assert_allclose(g @ kernel @ g.T, np.eye(300), atol=1e-6)


def test_words_are_fewer_where_there_are_fewer_different_descriptors():
    crops = [descriptors([[1.0], [2.0], [2.0]], [[0.1, 0.1]] * 3)] * 4
    np.testing.assert_array_equal(learn_vocabulary(crops, 1.0, n_words=5).words, [[1.0], [2.0]])


def test_words_lie_where_the_descriptors_gather_and_repeat_for_a_seed():
    generator = np.random.default_rng(0)
    crops = [
        descriptors(
            np.concatenate([generator.normal(c, 0.05, (5, 2)) for c in (0, 4)]), generator.random((10, 2))
        )
        for _ in range(20)
    ]
    first, second = (learn_vocabulary(crops, 1.0, n_words=2, seed=3).words for _ in range(2))
    np.testing.assert_array_equal(first, second)
    np.testing.assert_allclose(np.sort(first[:, 0]), [0, 4], atol=0.1)


def test_nothing_to_learn_from_is_an_error():
    empty = PatchDescriptors(np.zeros((0, 3), dtype=np.float32), np.zeros((0, 2), dtype=np.float32))
    with pytest.raises(DataError, match="none in any crop"):
        learn_vocabulary([empty], 1.0)
    with pytest.raises(SettingsError, match="n_words"):
        learn_vocabulary([empty], 1.0, n_words=0)
    with pytest.raises(SettingsError, match="gamma > 0"):
        Vocabulary.of([[1.0]], gamma=0.0)
    with pytest.raises(DataError, match=r"words \(w, k\)"):
        Vocabulary.of([1.0], gamma=1.0)
    with pytest.raises(DataError, match=r"positions \(m, 2\)"):
        PatchDescriptors(np.zeros((2, 3), dtype=np.float32), np.zeros((1, 2), dtype=np.float32))
