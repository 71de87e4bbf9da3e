"""The peers that solve one transport problem, each behind the same call; what can be got ready beforehand is."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.harness import version

__all__ = ["EMD_PEERS", "EMDPeer", "Problem"]

FloatArray = npt.NDArray[np.float64]
Solver = Callable[[Any], float]
_MAX_ITERATIONS = 100_000


@dataclass(frozen=True)
class Problem:
    """Weights (m,) and (n,) that add up to one each, and costs (m, n), all float64 and contiguous."""

    p: FloatArray
    q: FloatArray
    costs: FloatArray


@dataclass(frozen=True)
class EMDPeer:
    """A package that solves transport problems.

    prepare: a Problem in the arrays that the package wants. make: its solver of one prepared problem.
    tolerance: how near its values come to the exact ones, relative.
    """

    label: str
    package: str
    prepare: Callable[[Problem], Any]
    make: Callable[[], Solver]
    tolerance: float = 1e-9

    @property
    def version(self) -> str:
        """The installed version, '' where there is none."""
        return version(self.package)

    def loop(self, problems: Sequence[Problem]) -> Callable[[], list[float]]:
        """A function that solves all problems, one after the other. Raises ImportError where the peer is absent."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            solve = self.make()
        prepared = [self.prepare(problem) for problem in problems]
        return lambda: [solve(problem) for problem in prepared]


def _plain(problem: Problem) -> tuple[FloatArray, FloatArray, FloatArray]:
    return problem.p, problem.q, problem.costs


def _pot_emd2() -> Solver:
    import ot

    return lambda given: float(ot.emd2(*given))


def _pot_emd_c() -> Solver:
    from ot.lp.emd_wrap import emd_c

    return lambda given: float(emd_c(*given, _MAX_ITERATIONS, 1)[1])


def _wasserstein() -> Solver:
    import wasserstein

    solver = wasserstein.EMDFloat64(1.0, 1.0, False, False, True)
    return lambda given: float(solver(*given))


def _single(problem: Problem) -> tuple[npt.NDArray[np.float32], ...]:
    p, q, costs = (array.astype(np.float32) for array in _plain(problem))
    return p[:, None], q[:, None], costs


def _cv2() -> Solver:
    import cv2

    cv2.setNumThreads(1)
    return lambda given: float(cv2.EMD(given[0], given[1], cv2.DIST_USER, given[2])[0])


def _one_set_of_bins(problem: Problem) -> tuple[FloatArray, FloatArray, FloatArray]:
    m, n = problem.costs.shape
    costs = np.zeros((m + n, m + n))
    costs[:m, m:] = problem.costs
    costs[m:, :m] = problem.costs.T
    return np.append(problem.p, np.zeros(n)), np.append(np.zeros(m), problem.q), costs


def _pyemd() -> Solver:
    from pyemd import emd

    return lambda given: float(emd(*given))


EMD_PEERS = {
    "pot_emd2": EMDPeer("ot.emd2", "POT", _plain, _pot_emd2),
    "pot_emd_c": EMDPeer("POT's inner emd_c", "POT", _plain, _pot_emd_c),
    "wasserstein": EMDPeer("Wasserstein EMD", "Wasserstein", _plain, _wasserstein),
    "cv2": EMDPeer("cv2.EMD", "opencv-python-headless", _single, _cv2, tolerance=1e-4),
    "pyemd": EMDPeer("pyemd.emd", "pyemd", _one_set_of_bins, _pyemd, tolerance=1e-4),
}
