"""All distances among the places of a drive, two threads, against POT's kernel in two processes."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from benchmarks.data import N_PLACES, N_PLACES_QUICK, load_street
from benchmarks.emd_pairs import GROUND, heaviest
from benchmarks.harness import Comparison, Settings, interleaved_s, peak_memory_mb, threads, version
from depthprint import SignatureBatch, difference_matrix

__all__ = ["NAMES", "run"]

NAMES = ("matrix_pot",)


def run(settings: Settings, wanted: set[str]) -> list[Comparison]:
    """Ours in full, the peer's time for a seeded sample of the same pairs scaled up to all of them."""
    if not wanted:
        return []
    n = N_PLACES_QUICK if settings.quick else N_PLACES
    street = load_street(n).height
    batch = SignatureBatch.stack([heaviest(street[i], 20) for i in range(n)])
    rng = np.random.default_rng(0)
    sampled = rng.integers(0, n, (2000 if settings.quick else 20_000, 2))
    every = n * (n - 1) // 2
    with threads(settings.threads):
        _full(batch, 50)
        before = peak_memory_mb()
        started = time.perf_counter()
        matrix = difference_matrix(batch, masses="balanced", ground=GROUND)
        ours_s = time.perf_counter() - started
        memory = peak_memory_mb() - before
        size = f"{n} x {n}, 20 clusters"
        extra = {"memory_mb": memory, "pairs_sampled_of_peer": len(sampled), "peer_extrapolated": True}
        try:
            peer_s = _sample_s(batch, sampled, matrix, settings.threads)
        except ImportError as error:
            note = f"no ready-made wheel for this Python: {error}"
            return [_row(ours_s, None, size, settings, note, extra)]
    note = f"peer: {len(sampled)} pairs timed, scaled up to {every}"
    return [_row(ours_s, peer_s * every / len(sampled), size, settings, note, extra)]


def _row(
    ours_s: float, peer_s: float | None, size: str, settings: Settings, note: str, extra: Mapping[str, object]
) -> Comparison:
    return Comparison(
        "matrix_pot", ours_s, peer_s, "POT's emd_c over joblib", version("POT"), settings.threads, size, "matrix",
        note, extra,
    )  # fmt: skip


def _full(batch: SignatureBatch, n: int) -> None:
    """A small matrix: compiled or loaded before the clock starts."""
    difference_matrix(SignatureBatch.stack([batch[i] for i in range(n)]), masses="balanced", ground=GROUND)


def _sample_s(
    batch: SignatureBatch, pairs: npt.NDArray[np.int64], matrix: npt.NDArray[np.float64], n_jobs: int
) -> float:
    """Median seconds that the peer takes for the sampled pairs; processes are up before the clock starts."""
    import ot  # noqa: F401  (absent: said before any process starts)
    from joblib import Parallel, delayed

    masses = batch.weights.sum(axis=1, keepdims=True)
    weights = batch.weights / masses
    parts = np.array_split(pairs, 10 * n_jobs)
    with Parallel(n_jobs=n_jobs) as pool:

        def solve() -> list[npt.NDArray[np.float64]]:
            return list(
                pool(delayed(solve_pairs)(weights, batch.points, batch.counts, part) for part in parts)
            )

        values = np.concatenate(solve())
        difference = float(np.abs(values - matrix[pairs[:, 0], pairs[:, 1]]).max())
        if difference > 1e-9:
            raise ArithmeticError(f"POT's emd_c: differs from ours by {difference:.2g}, expected 1e-9")
        return interleaved_s({"peer": solve}, warm=False)["peer"]


def solve_pairs(
    weights: npt.NDArray[np.float64],
    points: npt.NDArray[np.float64],
    counts: npt.NDArray[np.int64],
    pairs: npt.NDArray[np.int64],
) -> npt.NDArray[np.float64]:
    """POT's values of some pairs, ground distances included, as a user would write it."""
    from ot.lp.emd_wrap import emd_c
    from scipy.spatial.distance import cdist

    values = np.empty(len(pairs))
    for k, (i, j) in enumerate(pairs):
        p, q = weights[i, : counts[i]], weights[j, : counts[j]]
        costs = np.minimum(cdist(points[i, : counts[i]], points[j, : counts[j]]), GROUND.cap)
        values[k] = emd_c(p, q, costs, 100_000, 1)[1]
    return values
