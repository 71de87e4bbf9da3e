"""What a query of a recogniser is described by: compiled loops against plain sums, shortcuts against the long way."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.baselines.kernel_descriptors.gradient import gradient_kernel
from depthprint.baselines.kernel_descriptors.kinds import KINDS
from depthprint.baselines.kernel_descriptors.match_features import PYRAMID, Vocabulary
from depthprint.baselines.kernel_descriptors.match_kernel import gaussian_kernel, gaussian_products
from depthprint.baselines.kernel_descriptors.patch_grid import mirrored_image
from depthprint.classification import NearestComplexityClassifier
from depthprint.encoder import load_shipped_encoder
from depthprint.encoding import Encoding
from depthprint.objects.distances import compare_complexities
from depthprint.objects.trained_recogniser import TrainedRecogniser
from depthprint.patches import extract_patches
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.settings import StreamSettings
from depthprint.simulation.objects import simulated_objects
from depthprint.sparse_coding import sparse_code
from depthprint.views import View, make_view, make_views


def bumpy(height, width, seed=0):
    generator = np.random.default_rng(seed)
    rows, columns = np.mgrid[:height, :width]
    depth_m = (
        0.8 + 0.03 * np.sin(rows / 5) + 0.02 * np.cos(columns / 7) + 0.002 * generator.random(rows.shape)
    )
    depth_m[generator.random(rows.shape) < 0.05] = np.nan
    depth_m[0, 0] = 0.8
    mask = np.zeros(rows.shape, dtype=bool)
    mask[height // 5 :, width // 4 :] = True
    camera = Pinhole(150.0, 150.0, width / 3, height / 2, width, height)
    return RangeImage(depth_m, camera, mask=mask)


@pytest.fixture(scope="module")
def views():
    objects = simulated_objects(n_categories=3, n_instances=2, frames=1, seed=12)
    return [(view, objects.read(view)) for view in objects.views]


@pytest.fixture(scope="module")
def recogniser(views):
    learned = views[::2]
    return TrainedRecogniser.fit(
        load_shipped_encoder("object"), [image for _, image in learned], [v.category for v, _ in learned]
    )


@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if not kind.mirror_free])
@pytest.mark.parametrize("shape", [(40, 53), (33, 48), (20, 13), (11, 30)])
def test_the_second_of_a_pair_are_the_descriptors_of_the_mirror_image(kind, shape):
    image = bumpy(*shape)
    for masked in (False, True):
        straight, mirrored = KINDS[kind].describe_pair(image, masked)
        for found, expected in (
            (straight, KINDS[kind].describe(image, masked)),
            (mirrored, KINDS[kind].describe(mirrored_image(image), masked)),
        ):
            np.testing.assert_array_equal(found.positions, expected.positions)
            np.testing.assert_allclose(
                found.vectors, expected.vectors, atol=2e-6 * np.abs(expected.vectors).max()
            )


def test_orientations_read_from_the_table_are_as_precise_as_single_precision():
    from depthprint._kernels.tables import read_rows
    from depthprint.baselines.kernel_descriptors.gradient import CIRCLE_NODES, _circle_kernels

    turns = np.random.default_rng(0).random(500)
    angles = 2 * np.pi * turns - np.pi
    kernel = gradient_kernel()
    exact = gaussian_kernel(np.stack([np.cos(angles), np.sin(angles)], 1), kernel.attribute, 5.0)
    expected = exact @ kernel.attribute_span.astype(np.float64)
    rows = np.empty((500, _circle_kernels().shape[1]), dtype=np.float32)
    read_rows(turns * CIRCLE_NODES + 1, _circle_kernels(), rows)
    np.testing.assert_allclose(rows[:, : expected.shape[1]], expected, atol=2e-6)
    assert not rows[:, expected.shape[1] :].any()


def test_products_of_table_rows_are_taken_value_by_value():
    from depthprint._kernels.tables import read_products, read_rows

    generator = np.random.default_rng(1)
    first, second = generator.random((2, 9, 12), dtype=np.float32)
    places = 1 + 6 * generator.random((2, 20))
    rows = np.empty((2, 20, 12), dtype=np.float32)
    for place, table, row in zip(places, (first, second), rows, strict=True):
        read_rows(place, table, row)
    np.testing.assert_array_equal(read_products(places[0], first, places[1], second), rows[0] * rows[1])


def kept_means_one_by_one(responses, positions):
    means = []
    for n in PYRAMID:
        column, row = np.minimum((positions * n).astype(int), n - 1).T
        for cell in range(n * n):
            inside = np.flatnonzero(n * row + column == cell)
            kept = {}
            for k in inside:
                word = responses[k].argmax()
                if word not in kept or responses[k, word] > responses[kept[word], word]:
                    kept[word] = k
            means.append(responses[list(kept.values())].sum(0) / max(1, len(kept)))
    return np.array(means)


@given(st.integers(0, 30), st.integers(1, 6), st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_each_word_of_a_cell_keeps_the_descriptor_that_responds_most(m, n_words, seed):
    from depthprint._kernels.kept_responses import kept_means

    generator = np.random.default_rng(seed)
    # Few different values, so that some are equal.
    responses = generator.integers(0, 5, (m, n_words)) / 4.0
    positions = generator.random((m, 2)).astype(np.float32)
    positions[: m // 5] = 1.0
    found = kept_means(responses, positions[:, 0], positions[:, 1], np.array(PYRAMID))
    np.testing.assert_allclose(found, kept_means_one_by_one(responses, positions), atol=1e-12)


def test_responses_to_words_are_their_kernel():
    generator = np.random.default_rng(2)
    vocabulary = Vocabulary.of(generator.normal(0, 2, (12, 30)), 0.1)
    vectors = generator.normal(0, 2, (7, 30)).astype(np.float32)
    expected = gaussian_products(vectors.astype(np.float64), vocabulary.words, 0.1)
    np.testing.assert_allclose(vocabulary.responses(vectors), expected, rtol=1e-11)


@given(st.integers(1, 4), st.integers(1, 40), st.integers(1, 20), st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_rows_with_zeros_have_the_product_of_all_their_values(n, d, r, seed):
    from depthprint._kernels.sparse_rows import sparse_products, sparse_products_in_halves

    generator = np.random.default_rng(seed)
    rows = (generator.random((n, d)) * (generator.random((n, d)) < 0.3)).astype(np.float32)
    matrix = generator.normal(size=(d, r)).astype(np.float32)
    np.testing.assert_allclose(sparse_products(rows, matrix), rows @ matrix, atol=1e-5)
    halves = (matrix.view(np.uint32) >> 16).astype(np.uint16)
    cut = (halves.astype(np.uint32) << 16).view(np.float32)
    np.testing.assert_array_equal(sparse_products_in_halves(rows, halves), sparse_products(rows, cut))


def test_the_views_of_all_streams_are_those_of_each(views):
    encoder = load_shipped_encoder("object")
    image = views[1][1]
    for view, stream in zip(make_views(image, encoder.settings), encoder.settings.streams, strict=True):
        alone = make_view(image, stream, encoder.settings)
        np.testing.assert_array_equal(view.channels, alone.channels)
        np.testing.assert_array_equal(view.support, alone.support)
        # A mirror image of its own is framed by other pixels where the aspect does not fit; most are the same.
        turned = make_view(mirrored_image(image), stream, encoder.settings)
        mirrored = make_view(image, stream, encoder.settings, mirror=True)
        assert np.mean(np.abs(turned.channels - mirrored.channels) < 0.05) > 0.95


def test_a_view_coded_beside_its_mirror_image_has_the_codes_that_it_has_alone(views):
    from depthprint.encoding import cluster_views, encode_clusters

    encoder = load_shipped_encoder("object")
    image = views[0][1]
    for stream, model in zip(encoder.settings.streams, encoder.streams, strict=True):
        pair = [make_view(image, stream, encoder.settings, mirror) for mirror in (False, True)]
        together = cluster_views(pair, stream, encoder.settings, model.dictionary)
        for found, mirror in zip(together, (False, True), strict=True):
            alone = encode_clusters(image, stream, encoder.settings, model.dictionary, mirror)
            np.testing.assert_array_equal(found.appearance, alone.appearance)
            np.testing.assert_array_equal(found.depth, alone.depth)


def test_models_of_some_signals_spread_over_all_are_the_models_of_all():
    generator = np.random.default_rng(3)
    atoms = generator.normal(size=(20, 9))
    atoms /= np.linalg.norm(atoms, axis=1, keepdims=True)
    signals = generator.normal(size=(11, 9)).astype(np.float32)
    signals[[0, 4, 5, 10]] = 0.0
    whole = sparse_code(signals, atoms, n_nonzero=3)
    busy = signals.any(axis=1)
    spread = sparse_code(signals[busy], atoms, n_nonzero=3).spread(busy)
    np.testing.assert_array_equal(spread.to_dense(), whole.to_dense())
    np.testing.assert_array_equal(spread.residual_norms, whole.residual_norms)
    np.testing.assert_array_equal(whole.rows(3, 8).to_dense(), whole.to_dense()[3:8])


@pytest.mark.parametrize("centre", [False, True])
def test_patches_are_the_windows_of_the_view(centre):
    generator = np.random.default_rng(4)
    support = generator.random((14, 17)) < 0.4
    support[:6, :7] = False
    channels = np.where(support, generator.random((2, 14, 17)), 0.0).astype(np.float32)
    depth = generator.random((14, 17)).astype(np.float32)
    stream = StreamSettings(view="depth", patch_shape=(4, 5), stride=3, centre=centre)
    found = extract_patches(View(channels, support, depth), stream)
    corners = [(top, left) for top in range(0, 11, 3) for left in range(0, 13, 3)]
    assert len(found.vectors) == len(corners)
    assert not support[:4, :5].any()
    for number, (top, left) in enumerate(corners):
        window = (slice(top, top + 4), slice(left, left + 5))
        inside = support[window]
        expected = np.stack([c[window] for c in channels])
        if centre:
            expected = expected - expected.mean(axis=(1, 2), keepdims=True)
        if not inside.any():
            expected = np.zeros_like(expected)
        np.testing.assert_allclose(found.vectors[number], expected.reshape(-1), atol=1e-6)
        mean = depth[window][inside].mean() if inside.any() else 0.0
        assert found.depth[number] == pytest.approx(mean, abs=1e-6)


def test_describing_beside_the_encoding_gives_what_describing_after_it_gives(recogniser, views):
    images = [image for _, image in views[1:4]]
    stored, encoder = recogniser.stored, recogniser.encoder
    after = stored.describe(encoder, encoder.describe_many(images), images)
    beside, _ = stored.encode_and_describe(encoder, images)
    for name in ("straight", "mirrored", "landmark", "surface", "mirrored_surface"):
        np.testing.assert_array_equal(getattr(beside, name), getattr(after, name))


def test_both_mirror_images_in_one_batch_have_the_distances_of_each(recogniser, views):
    encoder = recogniser.encoder
    encodings = encoder.describe_many([image for _, image in views[:4]])
    found = compare_complexities(encoder, encodings[:2], encodings)
    turned = [Encoding(e.mirrored.signatures, e.mirrored.vectors, e) for e in encodings[:2]]
    again = compare_complexities(encoder, turned, encodings)
    np.testing.assert_array_equal(found.mirrored, again.straight)
    np.testing.assert_array_equal(found.straight, again.mirrored)


def test_distances_by_class_are_those_of_the_ranking():
    generator = np.random.default_rng(5)
    labels = generator.integers(0, 4, 30).astype(str)
    among = generator.random((30, 30))
    classifier = NearestComplexityClassifier(local_scaling=3).fit((among + among.T) / 2, labels)
    queries = generator.random((6, 30))
    ranking = classifier.predict_with_distances(queries)
    found = classifier.nearest_by_class(queries)
    for row, (classes, distances) in enumerate(zip(ranking.labels, ranking.distances, strict=True)):
        order = np.searchsorted(classifier.classes_, classes)
        np.testing.assert_array_equal(found[row, order], distances)
