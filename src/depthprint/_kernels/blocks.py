"""Blocks of rows on worker threads: the same blocks, hence the same bits, on any number of threads."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from itertools import islice
from typing import Any

import numba
import numpy as np
from threadpoolctl import OpenBLASController, ThreadpoolController

__all__ = ["for_blocks", "holding_blas", "one_blas_thread"]

_WORTH_A_THREAD = 1e8  # some ten milliseconds; a hand-over costs up to one


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    # It knows the libraries that are loaded when it is made, of which scipy brings one of its own.
    import scipy.linalg  # noqa: F401

    return ThreadpoolController()


class _Held(threading.local):
    """How many times the calling thread, or the one that it works for, holds BLAS to one thread."""

    times = 0


_held = _Held()


class _Limit:
    """BLAS held to one thread while any thread of the process asks for it: there is one limit for all of them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holders = 0
        self._limiter: Any = None

    def take(self) -> None:
        with self._lock:
            if not self._holders:
                _let_any_thread_limit()
                self._limiter = _controller().limit(limits=1, user_api="blas")
            self._holders += 1

    def give(self) -> None:
        with self._lock:
            self._holders -= 1
            if not self._holders:
                _let_any_thread_limit()
                self._limiter.restore_original_limits()
                _let_any_thread_limit()


def _let_any_thread_limit() -> None:
    """Since 3.8 the thread that limits OpenBLAS is the only one whose limits count, until this; before, all were."""
    clear = getattr(OpenBLASController, "clear_controlling_thread", None)
    if clear is not None:
        clear(force=True)


_limit = _Limit()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread: its rounding depends on how many it uses. Within another such block nothing to do."""
    if _held.times:
        yield
        return
    _limit.take()
    try:
        with holding_blas():
            yield
    finally:
        _limit.give()


@contextmanager
def holding_blas() -> Iterator[None]:
    """What a thread works in whose caller holds BLAS to one thread already."""
    _held.times += 1
    try:
        yield
    finally:
        _held.times -= 1


def for_blocks(
    n_rows: int,
    block_rows: int,
    work: Callable[[int, int], None],
    progress: Callable[[int, int], None] | None = None,
    *,
    multiplications: float = np.inf,
) -> None:
    """Call ``work(start, stop)`` for every block of rows, on as many threads as numba may use.

    Which rows share a block depends on ``block_rows`` alone. ``multiplications`` estimates the whole work: where
    it is so little that handing it to threads would cost more than it saves, the calling thread does it all.
    The error of the first failing block is raised.
    """
    starts = range(0, n_rows, block_rows)
    workers = min(numba.get_num_threads(), len(starts)) if multiplications > _WORTH_A_THREAD else 1
    with one_blas_thread():
        if workers <= 1:
            for start in starts:
                stop = min(start + block_rows, n_rows)
                work(start, stop)
                if progress is not None:
                    progress(stop, n_rows)
            return
        pool = ThreadPoolExecutor(workers)

        def work_held(start: int, stop: int) -> None:
            with holding_blas():
                work(start, stop)

        try:
            remaining = iter(starts)
            pending: deque[tuple[int, Future[None]]] = deque()
            for start in islice(remaining, 4 * workers):
                pending.append((start, pool.submit(work_held, start, min(start + block_rows, n_rows))))
            while pending:
                start, future = pending.popleft()
                future.result()
                for following in islice(remaining, 1):
                    stop = min(following + block_rows, n_rows)
                    pending.append((following, pool.submit(work_held, following, stop)))
                if progress is not None:
                    progress(min(start + block_rows, n_rows), n_rows)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
