"""One exact search of an index: cheap bounds leave few candidates, dearer ones fewer, exact distances decide."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint._full_scan import FullScan
from depthprint._pairs import ROUNDING, check_status
from depthprint._signature_store import (
    ITEMS_PER_BLOCK,
    ITEMS_PER_GROUP,
    float32_holds,
    summary_slack,
    summary_vectors,
)

if TYPE_CHECKING:
    from depthprint._kernels.sweep import QueryTiles

__all__ = ["NearestSearch"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_FIRST_BATCH = 4
_SEED_BLOCKS = 2
_FEW_TO_SWEEP = 1 << 14
_FEW = 64
_FIRST_ROUND, _LARGEST_ROUND = 64, 1024
_MOST_DIMS = 1 << 14
_LARGEST = float(np.finfo(np.float64).max)
_BOUNDS_PER_ROW = 1024


class NearestSearch(FullScan):
    """A query against the first ``count`` items of its streams' stores.

    distance(query, item) = min over shifts of the streams' weighted sum. Every bound used is a lower bound of
    it, so what is dismissed for a bound over the k-th best distance so far cannot be among the k nearest.
    """

    def nearest(self, k: int) -> dict[int, tuple[float, int]]:
        """Best (distance, shift) of items, the k nearest certainly among them."""
        self._best: dict[int, tuple[float, int]] = {}
        self._nearest = np.full(max(1, min(k, self.count)), np.inf)
        if self.count <= max(k, _FEW) or not self._summaries_usable():
            self._decide(np.arange(self.count), np.zeros(self.count), None)
            return self._best
        self._prepare()
        if self.count <= _FEW_TO_SWEEP:
            self._search_blocks(np.arange(-(-self.count // ITEMS_PER_BLOCK)), k)
            return self._best
        blocks = self._block_bounds()
        wanted = min(_SEED_BLOCKS + k // ITEMS_PER_BLOCK, len(blocks))
        near = np.argpartition(blocks, wanted - 1)[:wanted]
        self._search_blocks(near, k)
        blocks[near] = np.inf
        self._search_blocks(np.flatnonzero(blocks <= self._threshold()), k)
        return self._best

    def _search_blocks(self, blocks: IntArray, k: int) -> None:
        """Decide all items of some blocks: the few of the least coded bounds, then those that are left."""
        groups, parts = self._coded_parts(blocks)
        bounds = parts.sum(axis=0) if len(parts) > 1 else parts[0]
        first = max(k, _FIRST_BATCH)
        if len(bounds) > first:
            tried = _few_least(bounds, first)
            tried = tried[bounds[tried] <= self._threshold()]
            self._decide_in_order(_items_at(groups, tried), parts[:, tried])
            bounds[tried] = np.inf
        left = np.flatnonzero(bounds <= self._threshold())
        items, parts = _items_at(groups, left), parts[:, left]
        if len(items) > _FEW:
            parts = self._swept_parts(items)
            kept = np.flatnonzero(parts.sum(axis=0) <= self._threshold())
            items, parts = items[kept], parts[:, kept]
        self._decide_in_order(items, parts)

    def _decide_in_order(self, items: IntArray, parts: FloatArray) -> None:
        bounds: FloatArray = parts.sum(axis=0)
        order = np.argsort(bounds, kind="stable")
        self._decide(items[order], bounds[order], parts[:, order] if self._sweep_is_whole else None)

    def _coded_parts(self, blocks: IntArray) -> tuple[IntArray, FloatArray]:
        """Groups of some blocks, and weighted bounds (streams, items) of distances to all their items from codes.

        They leave out the positions where there are several shifts, or a circular one. Those beyond the last item
        are inf.
        """
        from depthprint._kernels.codes import sweep_codes

        each = ITEMS_PER_BLOCK // ITEMS_PER_GROUP
        groups: IntArray = (np.sort(blocks)[:, None] * each + np.arange(each)).ravel()
        groups = groups[: np.searchsorted(groups, -(-self.count // ITEMS_PER_GROUP))]
        out = np.empty((len(self._stores), len(groups), ITEMS_PER_GROUP))
        for s, store in enumerate(self._stores):
            sweep_codes(
                self._codes[s], store.codes.view(np.int32)[..., 0], store.items(self.count, codes_alone=True),
                groups, float(self._streams[s].weight), self._rules[s], out[s],
            )  # fmt: skip
        self.bounds_computed += len(out) * min(out[0].size, self.count)
        return groups, out.reshape(len(out), -1)

    def _threshold(self) -> float:
        """Bounds over it are of no item among the k nearest; finite, since bounds of no item are inf."""
        return min(float(self._nearest[-1]) * ROUNDING, _LARGEST)

    def _decide(self, items: IntArray, bounds: FloatArray, swept: FloatArray | None) -> None:
        """Exact distances of those items, by rising bound, that may be among the k nearest.

        ``swept`` (streams, items): the streams' weighted parts of the bounds, which need no repeating where they
        hold all there is.
        """
        from depthprint._kernels.decision import decide

        start, size = 0, _FIRST_ROUND
        while start < len(items) and bounds[start] <= self._threshold():
            part = slice(start, start + size)
            streams = self._pairs_with(items[part])
            some = bounds[part]
            parts = np.empty((len(streams), 0)) if swept is None else swept[:, part]
            distances, shifts = np.full(len(some), np.inf), np.zeros(len(some), np.int64)
            solved, bounded, status = decide(streams, some, parts, self._nearest, distances, shifts)
            check_status(np.array([status]))
            self.emds_solved += solved
            self.bounds_computed += bounded
            for n in np.flatnonzero(distances < np.inf):
                self._best[int(items[start + n])] = float(distances[n]), int(shifts[n])
            start, size = start + size, min(2 * size, _LARGEST_ROUND)

    def _summaries_usable(self) -> bool:
        """Whether there are appearances, and float32 and 32-bit sums hold everything that cheap bounds add up."""
        blocks = -(-self.count // ITEMS_PER_BLOCK)
        for s, store in enumerate(self._stores):
            side, ground = self._sides[s], self._streams[s].ground
            if store.dims == ground.position_dims or store.dims > _MOST_DIMS:
                return False
            mass = max(float(side.masses[0]), float(store.mass_range[:blocks, 1].max(initial=0.0)))
            norm = max(float(np.abs(side.points).max(initial=0.0)), store.largest_norm)
            norm += float(np.abs(self._shifts[s]).max(initial=0.0))
            if not float32_holds(mass, norm, ground):
                return False
        return True

    def _prepare(self) -> None:
        """The query's codes of each stream."""
        from depthprint._kernels.codes import code_query

        one_shift = len(self._shifts[0]) == 1
        self._sweep_is_whole = one_shift and all(rules.period == 0.0 for rules in self._rules)
        self._codes = [code_query(*self._as_swept(s), store.dims) for s, store in enumerate(self._stores)]

    @cached_property
    def _vectors(self) -> list[npt.NDArray[np.float32]]:
        """The query's summary vector of each stream."""
        return [
            summary_vectors(side.weights, side.points.transpose(0, 2, 1), stream.ground)[0][0]
            for side, stream in zip(self._sides, self._streams, strict=True)
        ]

    @cached_property
    def _tiles(self) -> list[QueryTiles]:
        from depthprint._kernels.sweep import tile_query

        return [tile_query(*self._as_swept(s), store.largest_norm) for s, store in enumerate(self._stores)]

    def _as_swept(self, s: int) -> tuple[FloatArray, FloatArray, float, float]:
        """Points, weights, mass and complexity of the query; the points without positions if these may vary."""
        side, rules = self._sides[s], self._rules[s]
        points = side.points[0, : int(side.counts[0])].copy()
        appearance = points.shape[1] - rules.position_dims
        if self._sweep_is_whole:
            points[:, appearance:] += self._shifts[s][0]
        else:
            points = points[:, :appearance]
        return points, side.weights[0], float(side.masses[0]), float(side.complexity[0])

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

    def _swept_parts(self, items: IntArray) -> FloatArray:
        """Weighted bounds (streams, len(items)) of the distances to some items in float32.

        They leave out the positions where there are several shifts, or a circular one.
        """
        from depthprint._kernels.sweep import sweep_bounds

        parts = np.empty((len(self._stores), len(items)))
        for s, stream in enumerate(self._streams):
            parts[s] = sweep_bounds(self._tiles[s], self._items[s], items, self._rules[s])
            parts[s] *= stream.weight
        self.bounds_computed += parts.size
        return parts


def _items_at(groups: IntArray, places: IntArray) -> IntArray:
    """Numbers of the items at some places of groups side by side."""
    items: IntArray = groups[places // ITEMS_PER_GROUP] * ITEMS_PER_GROUP + places % ITEMS_PER_GROUP
    return items


def _few_least(bounds: FloatArray, count: int) -> IntArray:
    """Places of the least ``count`` bounds; of many bounds, the least of each of those rows that have the least."""
    rows = len(bounds) // _BOUNDS_PER_ROW
    if rows <= 4 * count:
        return np.argpartition(bounds, count - 1)[:count]
    table = bounds[: rows * _BOUNDS_PER_ROW].reshape(rows, _BOUNDS_PER_ROW)
    best = np.argpartition(table.min(axis=1), count - 1)[:count]
    places: IntArray = best * _BOUNDS_PER_ROW + table[best].argmin(axis=1)
    return places
