"""Directions in 16 bits a number: as near as that allows, and the same for one vector as for many."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.errors import DataError
from depthprint.objects.leading_directions import MAX_DIRECTIONS, LeadingDirections
from depthprint.objects.view_features import FEW_ROWS


@pytest.fixture(scope="module")
def vectors():
    rng = np.random.default_rng(3)
    return (rng.normal(size=(60, 12)) @ rng.normal(size=(12, 500))).astype(np.float32)


def test_they_span_what_the_vectors_do(vectors):
    directions = LeadingDirections.of(vectors, seed=0)
    assert directions.matrix().shape == (500, 60)
    basis = directions.matrix()[:, :12]
    np.testing.assert_allclose(basis.T @ basis, np.eye(12), atol=0.01)
    left = vectors - (vectors @ basis) @ basis.T
    assert np.linalg.norm(left) < 0.01 * np.linalg.norm(vectors)
    assert LeadingDirections.of(np.eye(400, dtype=np.float32), 0).upper_bits.shape[1] == MAX_DIRECTIONS


def test_numbers_are_rounded_to_the_nearest(vectors):
    from sklearn.utils.extmath import randomized_svd

    exact = randomized_svd(vectors, 60, n_iter=2, random_state=0)[2].T.astype(np.float32)
    found = LeadingDirections.of(vectors, seed=0).matrix()
    # Eight bits of mantissa, the first of them implied.
    assert (np.abs(found - exact) <= np.abs(exact) * 2.0**-8).all()
    assert abs(np.mean(found / exact - 1)) < 1e-4


def test_few_vectors_go_along_them_as_many_do(vectors):
    directions = LeadingDirections.of(vectors, seed=0)
    many = directions.along([vectors, vectors[:, ::-1]])
    for count in (1, FEW_ROWS // 2):
        few = directions.along([vectors[:count], vectors[:count, ::-1]])
        for some, all_of_them in zip(few, many, strict=True):
            np.testing.assert_allclose(some, all_of_them[:count], atol=1e-5)
            np.testing.assert_allclose(np.linalg.norm(some, axis=1), 1.0, rtol=1e-5)


@pytest.mark.parametrize(
    "bits",
    [
        np.zeros((3, 2), np.float32),
        np.zeros(3, np.uint16),
        np.full((3, 2), 0x7F80, np.uint16),
    ],
)
def test_what_is_no_matrix_of_finite_numbers_is_refused(bits):
    with pytest.raises(DataError, match="finite numbers"):
        LeadingDirections(bits)
