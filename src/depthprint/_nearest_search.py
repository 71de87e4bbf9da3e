"""One exact search of an index: cheap bounds leave few candidates, dearer ones fewer, exact distances decide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint._pairs import check_status, pair_rules
from depthprint._signature_store import (
    ITEMS_PER_BLOCK,
    ITEMS_PER_GROUP,
    SignatureStore,
    float32_holds,
    summary_slack,
    summary_vectors,
)

if TYPE_CHECKING:
    from depthprint._kernels.ground import Side
    from depthprint._kernels.sweep import QueryTiles
    from depthprint.signature_index import StreamDistance

__all__ = ["NearestSearch"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# Bounds are sums in floating point; nothing within rounding of the k-th best is dismissed.
_ROUNDING = 1.0 + 1e-12
_FIRST_BATCH, _LARGEST_BATCH = 4, 64
_SEED_BLOCKS = 2
_FEW = 64
_PAIRS_ON_ONE_THREAD = 16
_FIRST_ROUND = 64
_BLOCKS_PER_SWEEP = 2048
_ITEMS_PER_SCAN = 4096


class NearestSearch:
    """A query against the first ``count`` items of its streams' stores.

    distance(query, item) = min over shifts of the streams' weighted sum. Every bound used is a lower bound of
    it, so what is dismissed for a bound over the k-th best distance so far cannot be among the k nearest.
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
        self.count = count
        self._best: dict[int, tuple[float, int]] = {}
        self.bounds_computed = 0
        self.emds_solved = 0

    def nearest(self, k: int) -> dict[int, tuple[float, int]]:
        """Best (distance, shift) of items, the k nearest certainly among them."""
        if self.count <= max(k, _FEW) or not self._summaries_usable():
            self._decide(np.arange(self.count), np.zeros(self.count), None, k)
            return self._best
        self._prepare()
        blocks = self._block_bounds()
        wanted = min(_SEED_BLOCKS + k // ITEMS_PER_BLOCK, len(blocks))
        near = np.argpartition(blocks, wanted - 1)[:wanted]
        seeds = self._members(near)
        seed_parts = self._swept_parts(seeds)
        bounds: FloatArray = np.sum(seed_parts, axis=0)
        order = np.argsort(bounds, kind="stable")
        tried, left = np.split(order, [max(k, _FIRST_BATCH)])
        self._decide(seeds[tried], bounds[tried], [part[tried] for part in seed_parts], k)

        blocks[near] = np.inf
        near_enough = np.flatnonzero(blocks <= self._threshold(k))
        items, parts = seeds[left], [part[left] for part in seed_parts]
        for start in range(0, len(near_enough), _BLOCKS_PER_SWEEP):
            some, some_parts = self._sweep(near_enough[start : start + _BLOCKS_PER_SWEEP], self._threshold(k))
            items = np.concatenate([items, some])
            parts = [np.concatenate(both) for both in zip(parts, some_parts, strict=True)]
        bounds = np.sum(parts, axis=0)
        order = np.argsort(bounds, kind="stable")
        self._decide(items[order], bounds[order], [part[order] for part in parts], k)
        return self._best

    def _sweep(self, blocks: IntArray, threshold: float) -> tuple[IntArray, list[FloatArray]]:
        """Items of some blocks whose bounds are no more than ``threshold``, and the streams' parts of the bounds."""
        items = self._members(blocks)
        items = items[self._item_bounds(items) <= threshold]
        parts = self._swept_parts(items)
        kept = np.flatnonzero(np.sum(parts, axis=0) <= threshold)
        return items[kept], [part[kept] for part in parts]

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
        best = np.full(len(items), np.inf)
        for start in range(0, len(items), _ITEMS_PER_SCAN):
            scanned = items[start : start + _ITEMS_PER_SCAN]
            nearest = best[start : start + _ITEMS_PER_SCAN]
            parts = self._relaxed_parts(scanned)
            bounds: FloatArray = np.sum(parts, axis=0)
            ranked = np.argsort(bounds, axis=1, kind="stable")
            for rank in range(ranked.shape[1]):
                limits = nearest * _ROUNDING
                rows = np.flatnonzero(bounds[np.arange(len(scanned)), ranked[:, rank]] <= limits)
                exact = self._exact(scanned, parts, rows, ranked[rows, rank], limits[rows])
                nearest[rows] = np.minimum(nearest[rows], exact)
        return best

    def _threshold(self, k: int) -> float:
        if len(self._best) < k:
            return np.inf
        distances = [distance for distance, _ in self._best.values()]
        kth = min(distances) if k == 1 else float(np.partition(distances, k - 1)[k - 1])
        return kth * _ROUNDING

    def _decide(
        self, items: IntArray, bounds: FloatArray, swept: Sequence[FloatArray] | None, k: int
    ) -> None:
        """Exact distances of those items, by rising bound, that may be among the k nearest.

        ``swept``: the streams' weighted parts of the bounds, which need no repeating where they hold all there is.
        """
        start, size = 0, _FIRST_ROUND
        while start < len(items) and bounds[start] <= self._threshold(k):
            part = slice(start, start + size)
            if swept is None or not self._sweep_is_whole:
                parts = self._relaxed_parts(items[part])
            else:
                parts = [whole[part, None] for whole in swept]
            self._solve_in_bound_order(items[part], parts, k)
            start, size = start + size, min(2 * size, _ITEMS_PER_SCAN)

    def _solve_in_bound_order(self, items: IntArray, parts: Sequence[FloatArray], k: int) -> None:
        flat: FloatArray = np.sum(parts, axis=0).ravel()
        order = np.argsort(flat, kind="stable")
        start, size = 0, _FIRST_BATCH
        while start < len(order):
            threshold = self._threshold(k)
            pairs = order[start : start + size]
            pairs = pairs[flat[pairs] <= threshold]
            if not len(pairs):
                return
            rows, shifts = np.divmod(pairs, len(self._shifts[0]))
            exact = self._exact(items, parts, rows, shifts, np.full(len(rows), threshold))
            for row, shift, distance in zip(rows.tolist(), shifts.tolist(), exact.tolist(), strict=True):
                if np.isfinite(distance):
                    item = int(items[row])
                    self._best[item] = min(self._best.get(item, (np.inf, -1)), (distance, shift))
            start += size
            size = min(2 * size, _LARGEST_BATCH)

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
            spare = above[alive] * _ROUNDING - total[alive] - others
            values, solved = self._solve(
                s, items[r], shift, spare / weight if weight > 0 else np.full(len(r), np.inf)
            )
            self.emds_solved += int(solved.sum())
            total[alive] += weight * values
            rest[alive] = others
            alive = alive[total[alive] + rest[alive] <= above[alive] * _ROUNDING]
        result = np.full(len(rows), np.inf)
        result[alive] = total[alive]
        return result

    def _solve(
        self, s: int, items: IntArray, shifts: IntArray, above: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Distances of one stream, inf where over ``above``, and which of them took an EMD."""
        from depthprint._kernels.pairs import pair_distances, solve_run

        side, others, count = self._sides[s], self._stores[s].gather(items), len(items)
        if count > _PAIRS_ON_ONE_THREAD:
            values, status, solved = pair_distances(
                side, others, shifts, above, self._shifts[s], self._rules[s]
            )
        else:  # other threads would take longer to wake up
            values, status, solved = np.empty(count), np.empty(count, np.int64), np.empty(count, np.int64)
            solve_run(
                side, others, 0, count, shifts, above, self._shifts[s], self._rules[s], values, status, solved
            )
        check_status(status)
        return values, solved

    def _summaries_usable(self) -> bool:
        """Whether there are appearances, and float32 holds everything that the cheap bounds add up."""
        if any(
            store.dims == rules.position_dims for store, rules in zip(self._stores, self._rules, strict=True)
        ):
            return False
        for s, store in enumerate(self._stores):
            side, ground = self._sides[s], self._streams[s].ground
            mass = max(float(side.masses[0]), float(store.masses[: self.count].max(initial=0.0)))
            norm = max(float(np.abs(side.points).max(initial=0.0)), store.largest_norm)
            norm += float(np.abs(self._shifts[s]).max(initial=0.0))
            if not float32_holds(mass, norm, ground):
                return False
        return True

    def _prepare(self) -> None:
        """The query as the cheap bounds take it: a summary vector, and tiles of points, for each stream."""
        from depthprint._kernels.sweep import tile_query

        self._vectors: list[npt.NDArray[np.float32]] = []
        self._tiles: list[QueryTiles] = []
        whole = len(self._shifts[0]) == 1
        self._sweep_is_whole = whole and all(rules.period == 0.0 for rules in self._rules)
        for s, side in enumerate(self._sides):
            vectors, _ = summary_vectors(
                side.weights, side.points.transpose(0, 2, 1), self._streams[s].ground
            )
            self._vectors.append(vectors[0])
            points = side.points[0, : int(side.counts[0])].copy()
            positions = self._rules[s].position_dims
            appearance = points.shape[1] - positions
            if self._sweep_is_whole:
                points[:, appearance:] += self._shifts[s][0]
            else:
                points = points[:, :appearance]
            self._tiles.append(
                tile_query(
                    points, side.weights[0], float(side.masses[0]), float(side.complexity[0]),
                    self._stores[s].largest_norm,
                )
            )  # fmt: skip

    def _members(self, blocks: IntArray) -> IntArray:
        items: IntArray = (np.sort(blocks)[:, None] * ITEMS_PER_BLOCK + np.arange(ITEMS_PER_BLOCK)).ravel()
        return items[: np.searchsorted(items, self.count)]

    def _block_bounds(self) -> FloatArray:
        from depthprint._kernels.summaries import add_block_bounds

        out = np.zeros(-(-self.count // ITEMS_PER_BLOCK))
        for s, store in enumerate(self._stores):
            side, stream = self._sides[s], self._streams[s]
            add_block_bounds(
                self._vectors[s], side.masses[0], side.complexity[0], store.low, store.high, store.mass_range,
                store.largest_complexity, summary_slack(stream.ground), stream.weight, self._rules[s], out,
            )  # fmt: skip
        return out

    def _item_bounds(self, items: IntArray) -> FloatArray:
        from depthprint._kernels.summaries import add_item_bounds

        out = np.zeros(len(items))
        for s, store in enumerate(self._stores):
            side, stream = self._sides[s], self._streams[s]
            add_item_bounds(
                self._vectors[s], side.masses[0], side.complexity[0], store.vectors, store.masses,
                store.complexity, items, summary_slack(stream.ground), stream.weight, self._rules[s], out,
            )  # fmt: skip
        return out

    def _swept_parts(self, items: IntArray) -> list[FloatArray]:
        """Weighted bounds (len(items),) of each stream's distances to some items, in rising order, in float32.

        They leave out the positions where there are several shifts, or a circular one.
        """
        from depthprint._kernels.sweep import sweep_bounds

        group, lanes = np.divmod(items, ITEMS_PER_GROUP)
        first = np.diff(group, prepend=-1) > 0
        groups, where = group[first], np.cumsum(first) - 1
        parts = []
        for s, store in enumerate(self._stores):
            bounds = sweep_bounds(
                self._tiles[s], store.points, store.weights, store.counts[: self.count], store.masses,
                store.complexity, groups, self._rules[s],
            )  # fmt: skip
            parts.append(self._streams[s].weight * bounds[where, lanes])
            self.bounds_computed += len(items)
        return parts
