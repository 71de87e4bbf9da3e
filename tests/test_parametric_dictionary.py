"""Parametric dictionaries: unit, distinct, spanning, seeded."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.errors import SettingsError
from depthprint.parametric_dictionary import MOTHERS, _sample, parametric_dictionary
from depthprint.sparse_coding import sparse_code


@pytest.mark.parametrize("mother", MOTHERS)
@pytest.mark.parametrize("shape", [(8, 8), (12, 20), (32, 32)])
def test_atoms_are_unit_and_distinct_and_one_is_constant(mother, shape):
    dictionary = parametric_dictionary(shape, 256, mother=mother)
    assert dictionary.atoms.shape == (256, shape[0] * shape[1])
    np.testing.assert_allclose(np.linalg.norm(dictionary.atoms, axis=1), 1, atol=1e-12)
    assert np.ptp(dictionary.atoms[0]) == 0
    assert np.abs(dictionary.atoms @ dictionary.atoms.T - np.eye(256)).max() <= 0.97 + 1e-12


@pytest.mark.parametrize("mother", MOTHERS)
def test_small_patches_are_spanned(mother):
    singular = np.linalg.svd(parametric_dictionary((6, 6), 256, mother=mother).atoms, compute_uv=False)
    assert len(singular) == 36
    assert singular[-1] > 0.05


@pytest.mark.parametrize("mother", MOTHERS)
def test_error_of_a_smooth_image_falls_with_every_atom(mother):
    y, x = np.mgrid[0:16, 0:16] / 16
    image = (1 + 2 * x + np.where(x + y > 1, 1.5, 0) + np.sin(3 * y)).reshape(1, -1)
    dictionary = parametric_dictionary((16, 16), 256, mother=mother)
    left = [sparse_code(image, dictionary, n_nonzero=k).residual_norms[0] for k in (1, 3, 6, 12, 24)]
    assert (np.diff(left) < 0).all()
    assert left[-1] < 0.1 * np.linalg.norm(image)


def test_parameters_translate_rotate_and_stretch():
    def sample(row, column, angle, across, along):
        return _sample(MOTHERS["gaussian"], (16, 16), np.array([row, column, angle, across, along])).reshape(
            16, 16
        )

    flat, upright = sample(0.5, 0.5, 0, 0.8, 0.3), sample(0.5, 0.5, 0.5, 0.8, 0.3)
    np.testing.assert_allclose(upright, flat.T, atol=1e-12)
    assert np.square(flat).sum(axis=0).max() < 0.5 * np.square(flat).sum(axis=1).max()
    moved = sample(0.25, 0.75, 0, 0.3, 0.3)
    assert np.unravel_index(moved.argmax(), moved.shape) in {(3, 11), (4, 12), (3, 12), (4, 11)}


def test_the_seed_moves_the_atoms_and_nothing_else_does():
    first, again, other = (parametric_dictionary((8, 8), 64, seed=s) for s in (0, 0, 1))
    assert first.atoms.tobytes() == again.atoms.tobytes()
    assert first.fingerprint == again.fingerprint != other.fingerprint
    assert first.settings["mother"] == "gaussian"


@pytest.mark.parametrize(
    ("shape", "n_atoms", "options", "message"),
    [
        ((8, 8), 16, {"mother": "wavelet"}, "gaussian, edge, anisotropic_refinement, gabor"),
        ((0, 8), 16, {}, "at least 1"),
        ((8, 8), 0, {}, "at least 1"),
        ((2, 1), 256, {}, "found only"),
        ((8, 8), 16, {"largest_correlation": 1.5}, "between 0 and 1"),
    ],
)
def test_impossible_settings_are_refused(shape, n_atoms, options, message):
    with pytest.raises(SettingsError, match=message):
        parametric_dictionary(shape, n_atoms, **options)
