"""One contract for every method that names objects, on simulated objects."""

import numpy as np
import pytest

from depthprint.encoder import Encoder, load_shipped_encoder
from depthprint.encoder_ablations import without_pairs
from depthprint.errors import ModelError, SettingsError
from depthprint.objects.alignment import AGREEMENT_WEIGHT, align_object_views, proposed_views
from depthprint.objects.distances import complexity_distances, cosine_distances
from depthprint.objects.fused_recogniser import standardised
from depthprint.objects.methods import OBJECT_METHODS, make_object_method, make_object_methods
from depthprint.simulation.objects import simulated_objects

# Linear methods have no pairs, and a test file of their own.
QUICK = [name for name in OBJECT_METHODS if name != "ncd-zstd" and not name.startswith("kdes-")]
QUICK = [name for name in QUICK if not name.endswith("-svm")]


@pytest.fixture(scope="module")
def crops():
    objects = simulated_objects(n_categories=4, n_instances=3, frames=1, seed=5)
    return [objects.read(view) for view in objects.views], np.array([view.category for view in objects.views])


@pytest.mark.parametrize("name", QUICK)
def test_categories_are_named_better_than_by_chance(name, crops):
    images, categories = crops
    labels = np.unique(categories, return_inverse=True)[1].astype(np.int64)
    method = make_object_method(name)
    method.prepare(images)
    numbers = np.arange(len(images))
    test = numbers[::3]
    train = np.setdiff1d(numbers, test)
    predicted = method.predict(train, labels[train], test)
    assert predicted.shape == test.shape
    assert np.mean(predicted == labels[test]) > 0.25
    if name in ("recogniser-saved", "codes-svm-geometry"):
        assert np.isnan(method.us_per_pair), "compares no pairs"
    else:
        assert method.us_per_pair > 0


def test_geometry_is_all_that_parts_the_recogniser_from_the_row_without(crops):
    images, categories = crops
    labels = np.unique(categories, return_inverse=True)[1].astype(np.int64)
    test = np.arange(0, len(images), 3)
    train = np.setdiff1d(np.arange(len(images)), test)
    checked, plain = make_object_methods(["recogniser", "no-geometry"])
    for method in (checked, plain):
        method.prepare(images)
    scores, columns = plain.scores(train, labels[train], test)
    with_geometry, same = checked.scores(train, labels[train], test)
    np.testing.assert_array_equal(columns, same)
    np.testing.assert_array_equal(checked.proposer.scores(train, labels[train], test)[0], scores)
    likeness = plain.likeness(train, test)
    for row, query in enumerate(test):
        added = with_geometry[row] - standardised(scores[row : row + 1])[0]
        views = proposed_views(scores[row], columns, labels[train], likeness[row])
        own = [align_object_views(images[query], images[k]).agreement for k in train[views]]
        best = [max(a for a, k in zip(own, views, strict=True) if labels[train[k]] == c) for c in columns]
        np.testing.assert_allclose(added, AGREEMENT_WEIGHT * np.exp(12 * (np.array(best) - 0.8)), rtol=1e-6)


def test_distances_of_mirrored_presets_are_symmetric_and_zero_on_themselves(crops):
    encoder = load_shipped_encoder("object")
    encodings = encoder.describe_many(crops[0][:8])
    for matrix in (complexity_distances(encoder, encodings), cosine_distances(encoder, encodings)):
        assert np.allclose(matrix, matrix.T, atol=1e-6)
        assert np.allclose(np.diag(matrix), 0, atol=1e-6)
        assert (matrix[~np.eye(8, dtype=bool)] > 0).all()


def test_distances_to_others_are_rows_of_the_full_matrix(crops):
    encoder = load_shipped_encoder("object")
    encodings = encoder.describe_many(crops[0][:6])
    full = complexity_distances(encoder, encodings)
    assert np.allclose(complexity_distances(encoder, encodings[:2], encodings), full[:2], atol=1e-9)


def test_a_mirrored_object_is_as_near_as_the_object_itself(crops):
    # Pairs of points are alike in the mirror, but for which points are drawn.
    encoder = without_pairs(load_shipped_encoder("object"))
    image = crops[0][0]
    mirrored = image.replace(ranges_m=image.ranges_m[:, ::-1], mask=image.mask[:, ::-1])
    with_mirror = complexity_distances(
        encoder, encoder.describe_many([image]), encoder.describe_many([mirrored])
    )
    plain = Encoder(encoder.settings.model_copy(update={"mirror": False}), encoder.streams)
    without = complexity_distances(plain, plain.describe_many([image]), plain.describe_many([mirrored]))
    assert with_mirror[0, 0] < 0.5 * without[0, 0]


def test_unknown_and_unfitted_are_refused():
    with pytest.raises(SettingsError, match="emd-literal"):
        make_object_method("magic")
    with pytest.raises(ModelError, match="not fitted"):
        make_object_method("emd", model=Encoder.from_preset("object"))
