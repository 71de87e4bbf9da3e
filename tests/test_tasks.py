"""Short tasks side by side: each once, in whatever company."""

from __future__ import annotations

import re
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from depthprint._kernels.blocks import one_blas_thread
from depthprint._kernels.tasks import run_tasks

TIMEOUT_S = 60


@pytest.fixture(params=[1, 2, 4])
def n_threads(request, monkeypatch):
    monkeypatch.setattr("numba.get_num_threads", lambda: request.param)
    return request.param


def test_every_task_runs_once(n_threads):
    done = []
    run_tasks([partial(done.append, number) for number in range(100)])
    assert sorted(done) == list(range(100))
    assert n_threads > 1 or done == sorted(done)


def test_no_tasks_are_nothing_to_do(n_threads):
    before = threading.active_count()
    run_tasks([])
    assert threading.active_count() == before


def test_two_tasks_run_at_once(monkeypatch):
    monkeypatch.setattr("numba.get_num_threads", lambda: 2)
    both = threading.Barrier(2)
    run_tasks([partial(both.wait, TIMEOUT_S), partial(both.wait, TIMEOUT_S)])
    assert not both.broken


def test_one_thread_is_the_calling_one(monkeypatch):
    monkeypatch.setattr("numba.get_num_threads", lambda: 1)
    seen = []
    run_tasks([lambda: seen.append(threading.get_ident())] * 3)
    assert seen == [threading.get_ident()] * 3


def test_a_task_may_wait_for_an_earlier_one(n_threads):
    made: Future[int] = Future()
    found = []
    later = [lambda: found.append(made.result(TIMEOUT_S))] * 5
    run_tasks([lambda: made.set_result(7), *later])
    assert found == [7] * 5


def test_tasks_may_run_tasks_and_many_threads_may_call(n_threads):
    def count() -> int:
        done = []

        def inner():
            run_tasks([partial(done.append, 1)] * 5)

        run_tasks([inner] * 6)
        return len(done)

    with ThreadPoolExecutor(8) as callers:
        calls = [callers.submit(count) for _ in range(40)]
        assert [call.result(TIMEOUT_S) for call in calls] == [30] * 40


def test_the_first_error_is_raised_and_no_more_tasks_start(n_threads):
    started = []

    def fail(number):
        started.append(number)
        raise ValueError(number)

    with pytest.raises(ValueError, match=r"^0$"):
        run_tasks([partial(fail, number) for number in range(100)])
    assert len(started) <= n_threads


def test_other_threads_enter_no_parallel_kernels(monkeypatch):
    import numba

    allowed = numba.get_num_threads
    both = threading.Barrier(2)
    seen = {}

    def look():
        both.wait(TIMEOUT_S)
        seen[threading.get_ident()] = allowed()

    monkeypatch.setattr("numba.get_num_threads", lambda: 2)
    run_tasks([look, look])
    seen.pop(threading.get_ident())
    assert list(seen.values()) == [1]


def test_blas_is_held_to_one_thread_while_any_caller_asks_and_then_has_what_it_had():
    def threads_of_blas() -> set[int]:
        libraries = [one for one in threadpool_info() if one["user_api"] == "blas"]
        ours = [one for one in libraries if re.search("numpy|scipy", one["filepath"])]
        assert ours
        return {one["num_threads"] for one in ours}

    limits = threadpool_limits(2, user_api="blas")
    before = threads_of_blas()
    first_holds, second_holds, first_left = (threading.Event() for _ in range(3))
    seen = []

    def first():
        with one_blas_thread():
            first_holds.set()
            assert second_holds.wait(TIMEOUT_S)
        first_left.set()

    def second():
        assert first_holds.wait(TIMEOUT_S)
        with one_blas_thread():
            second_holds.set()
            assert first_left.wait(TIMEOUT_S)
            seen.append(threads_of_blas())

    with ThreadPoolExecutor(2) as callers:
        for call in [callers.submit(first), callers.submit(second)]:
            call.result(TIMEOUT_S)
    assert seen == [{1}]
    assert threads_of_blas() == before
    limits.restore_original_limits()
