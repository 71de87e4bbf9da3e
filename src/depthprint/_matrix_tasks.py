"""Which pairs of a difference matrix are computed: runs of columns, without those that a cheap bound rules out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint._pairs import ROUNDING
from depthprint._signature_store import float32_holds, summary_slack, summary_vectors
from depthprint.signature import GroundDistance

if TYPE_CHECKING:
    from depthprint._kernels.ground import PairRules, Side

__all__ = ["BelowBound", "row_tasks"]

IntArray = npt.NDArray[np.int64]


class BelowBound:
    """Columns of a row whose distance may be ``limit`` or less, by the bound of the summary vectors."""

    def __init__(
        self, left: Side, right: Side, ground: GroundDistance, rules: PairRules, limit: float
    ) -> None:
        self._left, self._right, self._rules, self._limit = left, right, rules, limit
        self._slack = summary_slack(ground)
        self._usable = bool(np.isfinite(limit))
        if self._usable:
            self._left_vectors, norm_p = summary_vectors(left.weights, left.points.transpose(0, 2, 1), ground)
            self._right_vectors, norm_q = summary_vectors(right.weights, right.points, ground)
            mass = max(left.masses.max(initial=0.0), right.masses.max(initial=0.0))
            self._usable = float32_holds(float(mass), max(norm_p, norm_q), ground)

    def columns(self, i: int, first: int) -> IntArray:
        """Rising columns from ``first`` on; all of them where no bound helps."""
        columns = np.arange(first, len(self._right.counts))
        if not self._usable:
            return columns
        from depthprint._kernels.summaries import add_item_bounds

        bounds = np.zeros(len(columns))
        add_item_bounds(
            self._left_vectors[i], self._left.masses[i], self._left.complexity[i], self._right_vectors,
            self._right.masses, self._right.complexity, columns, self._slack, 1.0, self._rules, bounds,
        )  # fmt: skip
        return columns[bounds <= self._limit * ROUNDING]


def row_tasks(i: int, columns: IntArray, step: int) -> IntArray:
    """(tasks, 3) of row, first and last column: runs of neighbouring columns, at most ``step`` each."""
    if not len(columns):
        return np.empty((0, 3), np.int64)
    breaks = np.flatnonzero(np.diff(columns) > 1) + 1
    starts, stops = columns[np.append(0, breaks)], columns[np.append(breaks, len(columns)) - 1] + 1
    pieces = -(-(stops - starts) // step)
    run = np.repeat(np.arange(len(starts)), pieces)
    piece = np.arange(len(run)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    first = starts[run] + piece * step
    return np.stack([np.full_like(first, i), first, np.minimum(first + step, stops[run])], axis=1)
