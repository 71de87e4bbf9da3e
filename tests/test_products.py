"""Small products in place of full blocks: same bits, fewer rows."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint._kernels.blocks import one_blas_thread
from depthprint._kernels.products import BLOCK_ROWS, block_rows_for
from depthprint.dictionary import Dictionary
from depthprint.sparse_coding import sparse_code


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("n_atoms", "dimension"), [(256, 80), (100, 150), (300, 40), (64, 2000)])
@pytest.mark.parametrize("n_rows", [1, 7, 21, 130])
def test_rows_of_a_padded_product_have_the_bits_of_a_full_block(dtype, n_atoms, dimension, n_rows):
    rng = np.random.default_rng(3)
    atoms = rng.standard_normal((n_atoms, dimension)).astype(dtype)
    full = rng.standard_normal((BLOCK_ROWS, dimension)).astype(dtype)
    height = block_rows_for(n_rows, np.dtype(dtype).name, n_atoms, dimension)
    assert n_rows <= height <= BLOCK_ROWS
    with one_blas_thread():
        assert ((full[:height] @ atoms.T)[:n_rows] == (full @ atoms.T)[:n_rows]).all()


def test_blocks_of_full_height_and_tiny_products_are_not_tried():
    assert block_rows_for(BLOCK_ROWS, "float32", 256, 9216) == BLOCK_ROWS
    assert block_rows_for(1, "float32", 7, 3) == BLOCK_ROWS


@pytest.mark.parametrize("algorithm", ["omp", "ols", "mp"])
def test_strided_reversed_and_read_only_signals_are_coded_like_their_copies(algorithm):
    rng = np.random.default_rng(0)
    atoms = rng.standard_normal((40, 30))
    atoms = Dictionary(atoms / np.linalg.norm(atoms, axis=1, keepdims=True))
    base = rng.standard_normal((600, 60))
    for view in (base[::-1, ::2], np.asfortranarray(base[:, :30]), base[::2, 30:]):
        view.setflags(write=False)
        plain = sparse_code(view.copy(order="C"), atoms, algorithm=algorithm, n_nonzero=4)
        given = sparse_code(view, atoms, algorithm=algorithm, n_nonzero=4)
        assert given.coefficients.tobytes() == plain.coefficients.tobytes()
        assert given.residual_norms.tobytes() == plain.residual_norms.tobytes()


@pytest.mark.parametrize("algorithm", ["omp", "ols"])
@pytest.mark.parametrize("share", [1.0, 1e-1, 1e-2, 1e-3, 1e-5])
def test_residual_norms_are_right_however_little_is_left(algorithm, share):
    rng = np.random.default_rng(1)
    atoms = rng.standard_normal((50, 600))
    atoms = Dictionary(atoms / np.linalg.norm(atoms, axis=1, keepdims=True))
    picked = rng.standard_normal((80, 3)) @ atoms.atoms[:3]
    noise = rng.standard_normal(picked.shape)
    signals = picked + share * noise * np.linalg.norm(picked) / np.linalg.norm(noise)
    for dtype, accuracy in ((np.float32, 1e-3), (np.float64, 1e-8)):
        model = sparse_code(signals.astype(dtype), atoms, algorithm=algorithm, n_nonzero=6)
        exact = np.linalg.norm(
            signals.astype(dtype).astype(float) - model.to_dense().astype(float) @ atoms.atoms, axis=1
        )
        np.testing.assert_allclose(model.residual_norms, exact, rtol=accuracy)
