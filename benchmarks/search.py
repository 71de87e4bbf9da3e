"""Exact search for the nearest place: against solving every EMD, and how it grows with the number of places."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from benchmarks.data import GAP, N_PLACES, N_PLACES_QUICK, N_QUERIES, Street, load_street
from benchmarks.harness import Comparison, Settings, interleaved_s, peak_memory_mb, threads
from depthprint import (
    GroundDistance,
    Signature,
    SignatureBatch,
    SignatureIndex,
    StreamDistance,
    difference_matrix,
)
from depthprint import __version__ as our_version

__all__ = ["NAMES", "run"]

NAMES = ("nearest_brute_force", "nearest_brute_force_street", "scaling")
GROUND = GroundDistance(cap=2.0, position_dims=1)
STREAM = StreamDistance(GROUND, "null", "information")
_SHIFTS = (
    np.array([0, -1, 1, -2, 2, -3, 3])[:, None] / 24 * 0.25
)  # sectors, in the preset's units of position
_SIZES = (1_000, 10_000, 100_000, 1_000_000)
_CHUNK = 10_000
_NOISE = 0.02


def run(settings: Settings, wanted: set[str]) -> list[Comparison]:
    """The rows asked for, with the settings of the street preset: unit masses, surplus to the null element."""
    n = N_PLACES_QUICK if settings.quick else N_PLACES
    street = load_street(n)
    street = Street(_unit_masses(street.height), _unit_masses(street.counts))
    rows = []
    with threads(settings.threads):
        if "nearest_brute_force" in wanted:
            rows.append(_one_stream(street.height, n, settings))
        if "nearest_brute_force_street" in wanted:
            rows.append(_street_preset(street, n, settings))
        if "scaling" in wanted:
            rows.append(_scaling(street.height, n, settings))
    return rows


def _unit_masses(batch: SignatureBatch) -> SignatureBatch:
    return SignatureBatch((batch.weights > 0).astype(float), batch.points, batch.counts, batch.fingerprint)


def _query_frames(n_places: int, count: int) -> list[int]:
    """Frames that follow the places after a gap: some come back to a place, some see a street for the first time."""
    return [int(i) for i in np.linspace(n_places + GAP, n_places + GAP + N_QUERIES - 1, count)]


def _one_stream(batch: SignatureBatch, n: int, settings: Settings) -> Comparison:
    queries = [batch[i] for i in _query_frames(n, 5 if settings.quick else 40)]
    places = SignatureBatch.stack([batch[i] for i in range(n)])
    index = SignatureIndex([STREAM])
    _add(index, places)
    few = SignatureBatch.stack(queries[:5])

    def brute_force() -> npt.NDArray[np.float64]:
        return difference_matrix(few, places, masses=STREAM.masses, ground=GROUND, form=STREAM.form)

    def search() -> list[float]:
        return [index.query([query])[0].distance for query in queries]

    difference = np.abs(np.array(search()[: len(few)]) - brute_force().min(axis=1)).max()
    _refuse_difference(float(difference))
    share = _share_solved(index, [[query] for query in queries], n)
    taken = interleaved_s({"ours": search, "all": brute_force})
    return Comparison(
        "nearest_brute_force", taken["ours"] / len(queries), taken["all"] / len(few), "all EMDs, our kernel",
        our_version,
        settings.threads, f"{n} places, k = 1, one stream, no shift", "query",
        extra={"share_of_emds_solved": share, "n_queries": len(queries)},
    )  # fmt: skip


def _street_preset(street: Street, n: int, settings: Settings) -> Comparison:
    index = SignatureIndex([STREAM, STREAM], shifts=[_SHIFTS, _SHIFTS])
    for i in range(n):
        index.add([street.height[i], street.counts[i]])
    frames = _query_frames(n, 3 if settings.quick else 10)
    queries = [[street.height[i], street.counts[i]] for i in frames]
    few = queries[:2]

    def all_exact() -> list[float]:
        return [float(index.distances(query).min()) for query in few]

    def search() -> list[float]:
        return [index.query(query)[0].distance for query in queries]

    _refuse_difference(float(np.abs(np.array(search()[: len(few)]) - all_exact()).max()))
    share = _share_solved(index, queries, 2 * n * len(_SHIFTS))
    taken = interleaved_s({"ours": search, "all": all_exact})
    return Comparison(
        "nearest_brute_force_street", taken["ours"] / len(queries), taken["all"] / len(few),
        "every place's exact distance", our_version, settings.threads,
        f"{n} places, k = 1, two streams, {len(_SHIFTS)} shifts", "query",
        extra={"share_of_emds_solved": share, "n_queries": len(queries)},
    )  # fmt: skip


def _scaling(batch: SignatureBatch, n: int, settings: Settings) -> Comparison:
    queries = [[batch[i]] for i in _query_frames(n, 5 if settings.quick else 20)]
    sizes = _SIZES[:2] if settings.quick else _SIZES
    index = SignatureIndex([STREAM])
    places = _simulated_places(batch, n, np.random.default_rng(0))
    kept_bytes = (
        4 if hasattr(index, "extend") else 3 * 8
    )  # an array that doubles is there thrice while it grows
    before = peak_memory_mb()
    points: list[dict[str, float]] = []
    note = ""
    for size in sizes:
        needed = 2 * kept_bytes * size * batch.weights.shape[1] * (1 + batch.points.shape[2])
        if needed > _free_bytes():
            note = f"{size} places left out: too little memory free"
            break
        while len(index) < size:
            _add(index, next(places), size - len(index))
        # Some kernels are first needed, and compiled, by a query that leaves many places.
        for query in queries if not points else queries[:1]:
            index.query(query)
        seconds, solved = [], []
        for query in queries:
            started = time.perf_counter()
            index.query(query)
            seconds.append(time.perf_counter() - started)
            solved.append(index.statistics.emds_solved)
        points.append(
            {
                "places": size,
                "query_s": statistics.median(seconds),
                "slowest_query_s": max(seconds),
                "share_of_emds_solved": statistics.mean(solved) / size,
                "index_mb": index.nbytes / 1e6,
                "memory_mb": peak_memory_mb() - before,
            }
        )
    logs = np.log([[point["places"], point["query_s"]] for point in points])
    exponent = float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])
    return Comparison(
        "scaling", points[-1]["query_s"], None, "", "", settings.threads,
        f"up to {int(points[-1]['places'])} places, k = 1, one stream, no shift", "query", note,
        {"points": points, "exponent": exponent},
    )  # fmt: skip


def _simulated_places(batch: SignatureBatch, n: int, rng: np.random.Generator) -> Iterator[SignatureBatch]:
    """Ever more simulated places: the left of one frame of the drive beside the right of another, with noise.

    Frames without a full set of columns are left out. The noise moves the appearance of each column; its place
    among the coordinates, the last of them, stays. Coordinates are rounded to single precision, in which an index
    may then keep them.
    """
    whole = np.flatnonzero(batch.counts[:n] == batch.weights.shape[1])
    columns = batch.weights.shape[1]
    while True:
        left, right = rng.choice(whole, _CHUNK), rng.choice(whole, _CHUNK)
        from_left = np.arange(columns) < rng.integers(1, columns, _CHUNK)[:, None]
        points = np.where(from_left[..., None], batch.points[left], batch.points[right])
        points[..., :-1] += _NOISE * rng.standard_normal(points[..., :-1].shape)
        points = points.astype(np.float32).astype(np.float64)
        counts = np.full(_CHUNK, columns, dtype=np.int64)
        yield SignatureBatch(np.ones((_CHUNK, columns)), points, counts, batch.fingerprint)


def _add(index: SignatureIndex, batch: SignatureBatch, most: int | None = None) -> None:
    n = len(batch) if most is None else min(most, len(batch))
    part = SignatureBatch(batch.weights[:n], batch.points[:n], batch.counts[:n], batch.fingerprint)
    index.extend([part])


def _share_solved(index: SignatureIndex, queries: list[list[Signature]], pairs: int) -> float:
    solved = []
    for query in queries:
        index.query(query)
        solved.append(index.statistics.emds_solved)
    return statistics.mean(solved) / pairs


def _refuse_difference(difference: float) -> None:
    if difference > 1e-9:
        raise ArithmeticError(f"search: the nearest is {difference:.2g} off the least of all distances")


def _free_bytes() -> float:
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError):
        return float("inf")  # not every system tells
