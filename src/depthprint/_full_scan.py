"""A query against all items of an index: lower bounds of their distances, and the exact ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint._pairs import ROUNDING, check_status, pair_rules
from depthprint._signature_store import SignatureStore

if TYPE_CHECKING:
    from depthprint._kernels.decision import StreamPairs
    from depthprint._kernels.ground import Side
    from depthprint.stream_distance import StreamDistance

__all__ = ["FullScan"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_ITEMS_PER_SCAN = 4096
_FEW_ITEMS = 64


class FullScan:
    """A query against the first ``count`` items of its streams' stores.

    distance(query, item) = min over shifts of the streams' weighted sum.
    """

    def __init__(
        self,
        streams: Sequence[StreamDistance],
        shifts: Sequence[FloatArray],
        stores: Sequence[SignatureStore],
        sides: Sequence[Side],
        count: int,
    ) -> None:
        self._streams, self._shifts, self._stores, self._sides = streams, shifts, stores, sides
        self._rules = [pair_rules(s.masses, s.form, s.ground) for s in streams]
        self._items = [store.items(count) for store in stores]
        self.count = count
        self.bounds_computed = 0
        self.emds_solved = 0

    def relaxed(self, items: IntArray | None = None) -> tuple[FloatArray, IntArray]:
        """Lower bounds of distances (m,), of all items when None, and the shifts that give them; solves nothing."""
        items = np.arange(self.count) if items is None else items
        least, shift = np.empty(len(items)), np.empty(len(items), np.int64)
        for start in range(0, len(items), _ITEMS_PER_SCAN):
            part = slice(start, start + _ITEMS_PER_SCAN)
            bounds: FloatArray = np.sum(self._relaxed_parts(items[part]), axis=0)
            least[part], shift[part] = bounds.min(axis=1), bounds.argmin(axis=1)
        return least, shift

    def all_exact(self, items: IntArray | None = None) -> FloatArray:
        """Least exact distances (m,), of all items when None; per item, shifts in the order of their bounds."""
        items = np.arange(self.count) if items is None else items
        if 0 < len(items) <= _FEW_ITEMS:
            return self._few_exact(items)
        best = np.full(len(items), np.inf)
        for start in range(0, len(items), _ITEMS_PER_SCAN):
            scanned = items[start : start + _ITEMS_PER_SCAN]
            nearest = best[start : start + _ITEMS_PER_SCAN]
            parts = self._relaxed_parts(scanned)
            bounds: FloatArray = np.sum(parts, axis=0)
            ranked = np.argsort(bounds, axis=1, kind="stable")
            for rank in range(ranked.shape[1]):
                limits = nearest * ROUNDING
                rows = np.flatnonzero(bounds[np.arange(len(scanned)), ranked[:, rank]] <= limits)
                exact = self._exact(scanned, parts, rows, ranked[rows, rank], limits[rows])
                nearest[rows] = np.minimum(nearest[rows], exact)
        return best

    def _few_exact(self, items: IntArray) -> FloatArray:
        """As ``all_exact``, in one compiled run on the calling thread."""
        from depthprint._kernels.decision import decide

        # As many are asked for as there are, so that none is given up.
        nearest = np.full(len(items), np.inf)
        distances, shifts = np.full(len(items), np.inf), np.zeros(len(items), np.int64)
        pairs = self._pairs_with(items)
        solved, bounded, status = decide(
            pairs, np.zeros(len(items)), np.empty((len(pairs), 0)), nearest, distances, shifts
        )
        check_status(np.array([status]))
        self.emds_solved += solved
        self.bounds_computed += bounded
        return distances

    def _pairs_with(self, items: IntArray) -> tuple[StreamPairs, ...]:
        """The query and some items, stream by stream, as `decide` takes them."""
        from depthprint._kernels.decision import StreamPairs

        return tuple(
            StreamPairs(side, store.gather(items), shifts, float(stream.weight), rules)
            for side, store, shifts, stream, rules in zip(
                self._sides, self._stores, self._shifts, self._streams, self._rules, strict=True
            )
        )

    def _relaxed_parts(self, items: IntArray) -> list[FloatArray]:
        """Weighted relaxed bounds (items, shifts) of each stream."""
        from depthprint._kernels.relaxation import relaxed_bounds

        parts = []
        for s, store in enumerate(self._stores):
            bounds = relaxed_bounds(
                self._sides[s], store.gather(items), len(items), self._shifts[s], self._rules[s]
            )
            parts.append(self._streams[s].weight * bounds)
            self.bounds_computed += bounds.size
        return parts

    def _exact(
        self,
        items: IntArray,
        parts: Sequence[FloatArray],
        rows: IntArray,
        shifts: IntArray,
        above: FloatArray,
    ) -> FloatArray:
        """Exact combined distances of items[rows]; inf where streams solved so far put a pair over ``above``."""
        total = np.zeros(len(rows))
        rest = np.sum([part[rows, shifts] for part in parts], axis=0)
        alive = np.arange(len(rows))
        for s in range(len(self._stores)):
            if not len(alive):
                break
            r, shift = rows[alive], shifts[alive]
            weight = self._streams[s].weight
            others = np.maximum(rest[alive] - parts[s][r, shift], 0.0)
            spare = above[alive] * ROUNDING - total[alive] - others
            values, solved = self._solve(
                s, items[r], shift, spare / weight if weight > 0 else np.full(len(r), np.inf)
            )
            self.emds_solved += int(solved.sum())
            total[alive] += weight * values
            rest[alive] = others
            alive = alive[total[alive] + rest[alive] <= above[alive] * ROUNDING]
        result = np.full(len(rows), np.inf)
        result[alive] = total[alive]
        return result

    def _solve(
        self, s: int, items: IntArray, shifts: IntArray, above: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Distances of one stream, inf where over ``above``, and which of them took an EMD."""
        from depthprint._kernels.pairs import pair_distances

        side, others = self._sides[s], self._stores[s].gather(items)
        values, status, solved = pair_distances(side, others, shifts, above, self._shifts[s], self._rules[s])
        check_status(status)
        return values, solved
