"""Exact EMD pair by pair, one thread, against every package that solves the same transport problem."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from benchmarks.data import N_PLACES_QUICK, load_patches, load_street
from benchmarks.harness import Comparison, Settings, interleaved_s, threads
from benchmarks.peers import EMD_PEERS, EMDPeer, Problem
from depthprint import GroundDistance, Signature, SignatureBatch
from depthprint.emd import emd_pairs_from_costs

__all__ = ["NAMES", "run"]

NAMES = (*(f"emd20_{peer}" for peer in EMD_PEERS), "emd121_pot_emd_c")
GROUND = GroundDistance(cap=2.0)


def run(settings: Settings, wanted: set[str]) -> list[Comparison]:
    """The rows asked for; all peers of one size are timed in the same rounds."""
    rows = []
    small = [name for name in EMD_PEERS if f"emd20_{name}" in wanted]
    if small:
        side = 10 if settings.quick else 30
        rows += _compare("emd20", small, *twenty_clusters(side))
    if "emd121_pot_emd_c" in wanted:
        side = 3 if settings.quick else 10
        batch = full_ones(load_patches(4 * side), 2 * side)
        rows += _compare("emd121", ["pot_emd_c"], _part(batch, 0, 2), _part(batch, 1, 2))
    return rows


def twenty_clusters(side: int) -> tuple[SignatureBatch, SignatureBatch]:
    """Twice ``side`` signatures of the simulated street, the 20 heaviest clusters of each."""
    street = load_street(N_PLACES_QUICK).height
    chosen = np.flatnonzero(street.counts >= 20)
    chosen = chosen[np.linspace(0, len(chosen) - 1, 2 * side).astype(int)]
    batch = SignatureBatch.stack([heaviest(street[int(i)], 20) for i in chosen])
    return _part(batch, 0, 2), _part(batch, 1, 2)


def full_ones(batch: SignatureBatch, n: int) -> SignatureBatch:
    """The first n signatures that have as many clusters as there can be: patches without a return make none."""
    full = np.flatnonzero(batch.counts == batch.counts.max())[:n]
    return SignatureBatch.stack([batch[int(i)] for i in full])


def heaviest(signature: Signature, n: int) -> Signature:
    """The n heaviest clusters, in the order that they had."""
    kept = np.sort(np.argsort(-signature.weights, kind="stable")[:n])
    return Signature(signature.weights[kept], signature.points[kept], signature.fingerprint)


def problems_of(a: SignatureBatch, b: SignatureBatch) -> list[Problem]:
    """Every pair of the two batches, masses brought to one, with its costs worked out."""
    from scipy.spatial.distance import cdist

    problems = []
    for i in range(len(a)):
        for j in range(len(b)):
            p, q = a[i], b[j]
            costs = np.minimum(cdist(p.points, q.points), GROUND.cap)
            problems.append(Problem(p.weights / p.mass, q.weights / q.mass, costs))
    return problems


def ours(problems: list[Problem]) -> Callable[[], npt.NDArray[np.float64]]:
    """All pairs in one call, from the same costs as the peers get."""
    p, q, costs = (np.stack([getattr(problem, name) for problem in problems]) for name in ("p", "q", "costs"))
    return lambda: np.asarray(emd_pairs_from_costs(p, q, costs, masses="balanced"))


def _part(batch: SignatureBatch, start: int, step: int) -> SignatureBatch:
    return SignatureBatch.stack([batch[i] for i in range(start, len(batch), step)])


def _compare(prefix: str, names: list[str], a: SignatureBatch, b: SignatureBatch) -> list[Comparison]:
    problems = problems_of(a, b)
    clusters = f"{problems[0].costs.shape[0]} x {problems[0].costs.shape[1]}"
    size = f"{len(problems)} pairs, {clusters} clusters"
    with threads(1):
        solve = ours(problems)
        exact = solve()
        contestants: dict[str, Callable[[], object]] = {"ours": solve}
        notes, differences = {}, {}
        for name in names:
            peer = EMD_PEERS[name]
            try:
                loop = peer.loop(problems)
            except ImportError as error:
                notes[name] = f"no ready-made wheel for this Python: {error}"
                continue
            differences[name] = _checked(peer, np.array(loop()), exact)
            contestants[name] = loop
        taken = interleaved_s(contestants)
    n = len(problems)
    return [
        Comparison(
            f"{prefix}_{name}",
            taken["ours"] / n,
            taken[name] / n if name in taken else None,
            EMD_PEERS[name].label,
            EMD_PEERS[name].version,
            1,
            size,
            "pair",
            notes.get(name, ""),
            {"largest_relative_difference": differences[name]} if name in differences else {},
        )
        for name in names
    ]


def _checked(peer: EMDPeer, values: npt.NDArray[np.float64], exact: npt.NDArray[np.float64]) -> float:
    """Largest difference relative to the value; ends the run where it is more than the peer's arithmetic explains."""
    difference = float((np.abs(values - exact) / exact.max()).max())
    if not difference <= peer.tolerance:
        raise ArithmeticError(
            f"{peer.label}: differs from ours by {difference:.2g}, expected {peer.tolerance:g}"
        )
    return difference
