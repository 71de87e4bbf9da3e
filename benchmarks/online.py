"""What the detector costs a frame, online, with thousands of places stored: the whole of it, and stage by stage."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any
from unittest.mock import patch

import numpy as np
import numpy.typing as npt

from benchmarks.data import DRIVE_SEED, GAP, N_PLACES, N_PLACES_QUICK, load_frames
from benchmarks.harness import Comparison, Settings, threads
from depthprint import RangeImage, Signature, make_place_recognizer
from depthprint.cascade.fused_recognizer import FusedRecognizer
from depthprint.cascade.verified_recognizer import VerifiedDescription, VerifiedRecognizer
from depthprint.encoding import Encoding
from depthprint.verification import verifier

__all__ = ["NAMES", "run"]

NAMES = ("online",)
_FRAMES, _FRAMES_QUICK = 500, 100
_GAP_QUICK = 20
_NOISE = 0.02
_WARM_UP = 20


@dataclass
class _Clock:
    """Seconds of processor time that each stage took, frame by frame: other work on the machine is not in it."""

    frames: list[dict[str, float]] = field(default_factory=list)

    def timed(self, stage: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """``work``, whose time is added to a stage of the last frame."""

        def run(*args: Any, **options: Any) -> Any:
            started = time.process_time()
            try:
                return work(*args, **options)
            finally:
                taken = time.process_time() - started
                self.frames[-1][stage] = self.frames[-1].get(stage, 0.0) + taken

        return run


def run(settings: Settings, wanted: set[str]) -> list[Comparison]:
    """The row asked for: describe, query and add of each frame of a drive, after the places of another town."""
    n_places = N_PLACES_QUICK if settings.quick else N_PLACES
    gap = _GAP_QUICK if settings.quick else GAP
    n_frames = _FRAMES_QUICK if settings.quick else _FRAMES
    drive, other_town = (load_frames(seed, n_frames) for seed in (DRIVE_SEED, DRIVE_SEED + 1))
    recognizer = make_place_recognizer("detector", "street")
    if not (isinstance(recognizer, VerifiedRecognizer) and isinstance(recognizer.inner, FusedRecognizer)):
        raise TypeError(f"expected the whole cascade, got a {type(recognizer).__name__}")
    with threads(settings.threads):
        _fill(recognizer, other_town, n_places - len(drive))
        for frame in other_town[:_WARM_UP]:
            recognizer.query(recognizer.describe(frame), limit=n_places - len(drive))
        clock = _Clock()
        with _stages(recognizer, recognizer.inner, clock):
            found = _drive(recognizer, drive, n_places - len(drive) - gap, clock)
    return [_row(clock, found, n_places, settings)]


def _drive(
    recognizer: VerifiedRecognizer, drive: Sequence[RangeImage], old_enough: int, clock: _Clock
) -> dict[str, npt.NDArray[Any]]:
    """Wall-clock and processor seconds of each frame, and whether geometry accepted its match."""
    wall, busy, accepted = [], [], []
    for number, frame in enumerate(drive):
        clock.frames.append({})
        started, working = time.perf_counter(), time.process_time()
        description = recognizer.describe(frame)
        matches = recognizer.query(description, limit=old_enough + number)
        recognizer.add(description)
        busy.append(time.process_time() - working)
        wall.append(time.perf_counter() - started)
        best = matches[0].verification if matches else None
        accepted.append(best is not None and best.accepted)
    return {"wall": np.array(wall), "busy": np.array(busy), "accepted": np.array(accepted)}


def _fill(recognizer: VerifiedRecognizer, frames: Sequence[RangeImage], count: int) -> None:
    """Store ``count`` places of a town: its frames' descriptions again and again, each time with other noise."""
    rng = np.random.default_rng(0)
    described = [recognizer.describe(frame) for frame in frames]
    for number in range(count):
        given = described[number % len(described)]
        # a view of its own each, as memory and caches would have it
        view = replace(given.view, ranges_m=given.view.ranges_m.copy())
        recognizer.add(VerifiedDescription(_perturbed(given.inner, rng), view))


def _perturbed(encoding: Encoding, rng: np.random.Generator) -> Encoding:
    signatures = tuple(
        Signature(s.weights, s.points + rng.normal(0.0, _NOISE, s.points.shape), s.fingerprint)
        for s in encoding.signatures
    )
    vectors = tuple((v + rng.normal(0.0, _NOISE, v.shape)).astype(np.float32) for v in encoding.vectors)
    return replace(encoding, signatures=signatures, vectors=vectors)


@contextmanager
def _stages(recognizer: VerifiedRecognizer, inner: FusedRecognizer, clock: _Clock) -> Iterator[None]:
    """Have every stage's work timed where it is called."""
    geometry = recognizer._verifier
    measured = (
        ("describe", inner, "describe"),
        ("view of the check", recognizer, "_make_view"),
        ("vector search", inner._vectors, "query"),
        ("relaxed bounds and exact distances", inner._index, "distances_of"),
        ("geometry", geometry, "verify"),
        ("of it coarse search", verifier, "best_starts"),
        ("of it alignment", geometry._quick, "refine"),
        ("of it agreement", verifier, "mutual_agreement"),
        ("add", recognizer, "add"),
    )
    with ExitStack() as stack:
        for stage, owner, name in measured:
            stack.enter_context(patch.object(owner, name, clock.timed(stage, getattr(owner, name))))
        yield


def _row(clock: _Clock, found: dict[str, npt.NDArray[Any]], n_places: int, settings: Settings) -> Comparison:
    stages = dict.fromkeys(name for frame in clock.frames for name in frame)
    accepted = found["accepted"]
    extra: dict[str, Any] = {
        "stages_ms": {name: _ms([frame.get(name, 0.0) for frame in clock.frames]) for name in stages},
        "wall_ms": _ms(found["wall"]),
        "processor_ms": _ms(found["busy"]),
        "wall_ms_accepted": _ms(found["wall"][accepted]),
        "wall_ms_others": _ms(found["wall"][~accepted]),
        "share_accepted": float(accepted.mean()),
        "n_frames": len(accepted),
    }
    return Comparison(
        "online", extra["wall_ms"][0] / 1e3, None, "", "", settings.threads,
        f"{n_places} places, describe, query with verification, and add", "frame",
        note=f"{accepted.mean():.0%} of {len(accepted)} frames accepted", extra=extra,
    )  # fmt: skip


def _ms(seconds: Any) -> list[float] | None:
    """Median and 99th percentile, milliseconds; None of nothing."""
    if not len(seconds):
        return None
    return [float(1e3 * np.median(seconds)), float(1e3 * np.percentile(seconds, 99))]
