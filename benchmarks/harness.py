"""Interleaved timing: whoever is compared takes turns, so that a busy or a slow minute falls on all alike."""

from __future__ import annotations

import resource
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any

__all__ = ["Comparison", "Settings", "interleaved_s", "peak_memory_mb", "threads", "version"]

ROUNDS = 5


@dataclass(frozen=True)
class Settings:
    """What a run asks for: full sizes or quick ones, and how many threads those may use that use several."""

    quick: bool = False
    threads: int = 2


@dataclass(frozen=True)
class Comparison:
    """One row: seconds of ours and of a peer for the same piece of work, named by ``unit``.

    A peer that could not be measured has no seconds, and ``note`` says why. ``extra``: further figures.
    """

    name: str
    ours_s: float | None
    peer_s: float | None
    peer: str
    peer_version: str
    threads: int
    size: str
    unit: str = ""
    note: str = ""
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ratio(self) -> float | None:
        """How many times as long the peer takes."""
        return self.peer_s / self.ours_s if self.ours_s and self.peer_s else None

    def as_json(self) -> dict[str, Any]:
        """The fields that every row has, then the row's own."""
        row = {
            "ours_s": self.ours_s,
            "peer_s": self.peer_s,
            "ratio": self.ratio,
            "peer": self.peer,
            "peer_version": self.peer_version,
            "threads": self.threads,
            "size": self.size,
            "unit": self.unit,
            "note": self.note,
        }
        return row | dict(self.extra)


def interleaved_s(
    contestants: Mapping[str, Callable[[], object]], rounds: int = ROUNDS, warm: bool = True
) -> dict[str, float]:
    """Median wall-clock seconds of each contestant over ``rounds`` turns; where ``warm``, one more goes before.

    The order turns round from one round to the next, so that nobody always follows the same one.
    """
    taken: dict[str, list[float]] = {name: [] for name in contestants}
    names = list(contestants)
    for turn in range(-int(warm), rounds):
        for name in names if turn % 2 else reversed(names):
            started = time.perf_counter()
            contestants[name]()
            if turn >= 0:
                taken[name].append(time.perf_counter() - started)
    return {name: statistics.median(seconds) for name, seconds in taken.items()}


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Hold numba, BLAS, OpenMP and OpenCV to so many threads."""
    import numba
    from threadpoolctl import threadpool_limits

    before = numba.get_num_threads()
    numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))
    try:
        with threadpool_limits(count):
            yield
    finally:
        numba.set_num_threads(before)


def version(package: str) -> str:
    """The installed version of a package, or '' where it is not there."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def peak_memory_mb() -> float:
    """The most memory that this process ever held, in MB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak / 1e3
