"""How many threads kernels may use, for a while; and a second thread for work of a millisecond."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache

import numba

__all__ = ["in_two", "one_thread"]


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold numba to the calling thread: a millisecond's work costs more to hand over, above all on a busy machine."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def in_two(work: Callable[[int, int], None], count: int) -> None:
    """``work(start, stop)`` of both halves of ``count``, side by side; of all at once where numba may use one thread.

    ``work`` must release the interpreter's lock to gain by it, and not call this. The thread is kept for the next call.
    """
    if numba.get_num_threads() < 2:
        work(0, count)
        return
    second = _second_thread(os.getpid()).submit(work, count // 2, count)
    try:
        work(0, count // 2)
    finally:
        second.result()


@lru_cache(maxsize=1)
def _second_thread(process: int) -> ThreadPoolExecutor:
    """A thread of this process: one that it was forked from has none to give."""
    del process
    return ThreadPoolExecutor(1, thread_name_prefix="depthprint")
