"""Work in two halves: what it covers, its errors, and that the bits of products do not depend on it."""

from __future__ import annotations

import threading

import numba
import numpy as np
import pytest

from depthprint._kernels.threads import in_two, one_thread
from depthprint.baselines.column_matching import products_with_rows


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_two_halves_cover_everything_once(count):
    done = np.zeros(count, dtype=int)

    def work(start: int, stop: int) -> None:
        done[start:stop] += 1

    in_two(work, count)
    with one_thread():
        in_two(work, count)
    assert (done == 2).all()


def test_one_thread_does_all_at_once_where_only_one_is_allowed():
    calls = []
    with one_thread():
        in_two(lambda start, stop: calls.append((start, stop, threading.current_thread())), 9)
    assert calls == [(0, 9, threading.current_thread())]


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="numba has one thread")
def test_error_of_either_half_is_raised_and_the_thread_serves_on():
    for failing in (0, 5):

        def work(start: int, stop: int, failing: int = failing) -> None:
            if start == failing:
                raise ArithmeticError(f"half from {start}")

        with pytest.raises(ArithmeticError, match=f"from {failing}"):
            in_two(work, 10)
    in_two(lambda start, stop: None, 10)


def test_products_with_many_rows_have_the_bits_of_one_thread():
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(7, 120)).astype(np.float32)
    rows = rng.normal(size=(2500, 120)).astype(np.float32)
    found = products_with_rows(vectors, rows)
    with one_thread():
        alone = products_with_rows(vectors, rows)
    np.testing.assert_array_equal(found, alone)
    np.testing.assert_allclose(found, vectors.astype(float) @ rows.T.astype(float), atol=1e-4)
