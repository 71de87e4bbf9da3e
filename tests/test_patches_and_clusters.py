"""From patches and codes to clusters."""

import numpy as np
import pytest

from depthprint.clusters import cell_grid, make_clusters
from depthprint.errors import SettingsError
from depthprint.patches import extract_patches
from depthprint.settings import StreamSettings
from depthprint.sparse_coding import sparse_code
from depthprint.views import View

RNG = np.random.default_rng(3)


def random_view(c=2, h=12, w=16) -> View:
    return View(
        RNG.normal(size=(c, h, w)).astype(np.float32), np.ones((h, w), bool), np.ones((h, w), np.float32)
    )


def atoms_for(d, n=32):
    atoms = RNG.normal(size=(n, d))
    return atoms / np.linalg.norm(atoms, axis=1, keepdims=True)


def test_patches_hold_the_pixels_at_their_positions():
    view = random_view()
    stream = StreamSettings(view="depth", patch_shape=(4, 4), stride=2)
    patches = extract_patches(view, stream)
    assert patches.vectors.shape == (5 * 7, 2 * 16)
    first_of_second_row = patches.vectors[7].reshape(2, 4, 4)
    assert np.array_equal(first_of_second_row, view.channels[:, 2:6, 0:4])
    assert np.allclose(patches.positions[7], [2 / 16, 4 / 12])


def test_wrapped_columns_continue_round_the_edge():
    view = random_view(1, 5, 8)
    stream = StreamSettings(
        view="polar", channels=("height",), patch_shape=(0, 3), stride=1, clusters="patches"
    )
    patches = extract_patches(view, stream, wraps=True)
    assert len(patches.vectors) == 8
    last = patches.vectors[7].reshape(5, 3)
    assert np.array_equal(last, view.channels[0][:, [7, 0, 1]])


def test_a_patch_larger_than_the_view_is_an_error():
    with pytest.raises(SettingsError, match="patch_shape"):
        extract_patches(random_view(), StreamSettings(view="depth", patch_shape=(40, 4)))


def test_max_pooling_equals_a_loop_over_patches_and_cells():
    view = random_view()
    stream = StreamSettings(view="depth", patch_shape=(4, 4), stride=2, cells=(2, 3), n_nonzero=3)
    patches = extract_patches(view, stream)
    atoms = atoms_for(32)
    model = sparse_code(patches.vectors, atoms, n_nonzero=3)
    clusters = make_clusters(model, patches, atoms, stream)
    dense = model.to_dense()
    centres, half = cell_grid(stream, 2)
    assert len(centres) == 4 + 9
    for cell in range(len(centres)):
        inside = (np.abs(patches.positions - centres[cell]) <= half[cell]).all(1)
        expected = np.concatenate([np.maximum(dense[inside], 0).max(0), np.maximum(-dense[inside], 0).max(0)])
        assert np.allclose(clusters.appearance[cell], expected)


def test_patch_clusters_are_the_reconstructions():
    view = random_view()
    stream = StreamSettings(view="depth", patch_shape=(4, 4), clusters="patches", n_nonzero=5)
    patches = extract_patches(view, stream)
    atoms = atoms_for(32)
    model = sparse_code(patches.vectors, atoms, n_nonzero=5)
    clusters = make_clusters(model, patches, atoms, stream)
    assert np.allclose(clusters.appearance, model.to_dense() @ atoms)


def test_picked_image_atoms_carry_sign_and_mass():
    view = random_view(1, 6, 6)
    stream = StreamSettings(
        view="raw-depth", atoms="image", clusters="atoms", n_nonzero=4, position_weight=0.0, point_dims=0
    )
    patches = extract_patches(view, stream)
    atoms = atoms_for(36)
    model = sparse_code(patches.vectors, atoms, n_nonzero=4)
    clusters = make_clusters(model, patches, atoms, stream)
    assert len(clusters.appearance) == 4
    assert np.allclose(clusters.appearance.sum(0), model.to_dense()[0])
    assert (np.count_nonzero(clusters.appearance, axis=1) == 1).all()
    assert (clusters.appearance < 0).any()
    unsigned = make_clusters(model, patches, atoms, stream.model_copy(update={"signed": False}))
    assert np.allclose(unsigned.appearance.sum(0), np.abs(model.to_dense()[0]))


def test_ground_points_of_picked_atoms_keep_the_distances_of_signed_atoms():
    encoder, images = literal_encoder()
    signature = encoder.describe(images[0]).signatures[0]
    _, _, model = encoder.codes(images[0])
    picked, coefficients = model.row(0)
    order = np.argsort(-np.abs(coefficients), kind="stable")
    signed = encoder.streams[0].dictionary.atoms[picked[order]] * np.sign(coefficients[order])[:, None]
    expected = np.linalg.norm(signed[:, None] - signed[None], axis=2)
    got = np.linalg.norm(signature.points[:, None] - signature.points[None], axis=2)
    assert np.allclose(got, expected, atol=1e-4)


def literal_encoder():
    from test_encoder import fitted

    return fitted("literal")
