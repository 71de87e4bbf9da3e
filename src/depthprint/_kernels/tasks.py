"""A few short tasks at once, on the calling thread and on threads that are kept for the next ones."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache

import numba

from depthprint._kernels.blocks import holding_blas, one_blas_thread

__all__ = ["run_tasks"]


def run_tasks(tasks: Sequence[Callable[[], None]]) -> None:
    """Run every task once, started in their order, on as many threads as numba may use.

    The calling thread takes part, so that tasks may run others and any number of threads may call. A task may wait for
    what an earlier one makes, which has been started by then. Others than the calling thread enter no parallel
    kernels, which numba's plainest threading layer bears from one thread alone. After an error no more tasks are
    started; that of the first failing task is raised.
    """
    left = deque(range(len(tasks)))
    errors: dict[int, BaseException] = {}

    def take() -> None:
        while left:
            try:
                number = left.popleft()
            except IndexError:  # another thread was faster
                return
            try:
                tasks[number]()
            except BaseException as error:
                errors[number] = error
                left.clear()

    def take_held() -> None:
        with holding_blas():
            take()

    with one_blas_thread():
        helpers: list[Future[None]] = []
        for _ in range(min(numba.get_num_threads(), len(tasks)) - 1):
            helpers.append(_pool().submit(take_held))
        take()
        for helper in helpers:
            # One that has not begun, since others keep all threads busy, has nothing left to do.
            if not helper.cancel():
                helper.result()
    if errors:
        raise errors[min(errors)]


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    workers = max(1, numba.config.NUMBA_NUM_THREADS - 1)
    return ThreadPoolExecutor(workers, "depthprint-task", initializer=numba.set_num_threads, initargs=(1,))


# A forked process has the pool but none of its threads.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)
