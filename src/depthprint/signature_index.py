"""Exact nearest signatures among many, with few EMDs: relaxed bounds propose, exact distances decide."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from depthprint._pairs import (
    Form,
    Masses,
    check_alike,
    check_form,
    check_masses,
    check_status,
    pair_rules,
    refuse_empty,
    shift_table,
    side_arrays,
)
from depthprint.errors import DataError, SettingsError
from depthprint.signature import GroundDistance, Signature, SignatureBatch

if TYPE_CHECKING:
    from depthprint._kernels.bounds import Side

__all__ = ["IndexMatch", "QueryStatistics", "SignatureIndex", "StreamDistance"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_ROUNDING = (
    1.0 + 1e-12
)  # bounds are sums in floating point; nothing within rounding of the k-th best is dismissed
_FIRST_SORTED = 256
_FIRST_BATCH, _LARGEST_BATCH = 8, 32


@dataclass(frozen=True)
class StreamDistance:
    """Distance of one stream of an item: ``weight`` times the normalised distance, or the EMD (form None)."""

    ground: GroundDistance = field(default_factory=GroundDistance)
    masses: Masses = "null"
    form: Form | None = "information"
    weight: float = 1.0

    def __post_init__(self) -> None:
        check_masses(self.masses)
        check_form(self.form)
        if not (np.isfinite(self.weight) and self.weight > 0):
            raise SettingsError(f"StreamDistance: expected a finite weight > 0, got {self.weight}")


class IndexMatch(NamedTuple):
    """An item of the index: its number, its distance, and the shift (row of ``shifts``) that gave it."""

    id: int
    distance: float
    shift_index: int


@dataclass(frozen=True)
class QueryStatistics:
    """Work of the last search: items looked at, relaxed bounds computed and EMDs solved, over all streams."""

    candidates: int = 0
    bounds: int = 0
    emds_solved: int = 0


class SignatureIndex:
    """Items of one signature a stream, numbered 0, 1, ... as added; exact search by the combined distance.

    distance(x, y) = min over shifts of sum over streams of weight * distance of the stream, with x (the
    query) moved by the same shift in all streams. ``shifts``: None, one table (S, position_dims) for all
    streams, or a list of one table (S, position_dims of the stream) each, row s being the same shift in each
    stream's own position units. A relaxed lower bound of every distance (each cluster goes to its nearest,
    from either side) sets the order in which EMDs are solved; the search ends when no bound is under the k-th
    best distance. Results equal a full scan's. Not safe for use from several threads at once; each search
    itself runs on numba's threads.
    """

    def __init__(
        self,
        streams: Sequence[StreamDistance],
        shifts: npt.NDArray[np.float64] | Sequence[npt.NDArray[np.float64]] | None = None,
    ) -> None:
        if not streams:
            raise SettingsError("SignatureIndex: expected at least one stream, got none")
        self.streams = tuple(streams)
        if shifts is None or isinstance(shifts, np.ndarray):
            tables = [shift_table(shifts, s.ground) for s in self.streams]
        else:
            if len(shifts) != len(self.streams):
                raise SettingsError(
                    f"SignatureIndex: expected one shift table for each of {len(self.streams)} streams, "
                    f"got {len(shifts)}"
                )
            tables = [shift_table(t, s.ground) for t, s in zip(shifts, self.streams, strict=True)]
        if len({len(t) for t in tables}) > 1:
            raise SettingsError(f"SignatureIndex: shift tables differ in length: {[len(t) for t in tables]}")
        self._shifts = tables
        self._stores: list[_Store] = []
        self.statistics = QueryStatistics()

    def __len__(self) -> int:
        return self._stores[0].count if self._stores else 0

    def add(self, signatures: Sequence[Signature]) -> int:
        """Store an item, one signature a stream, and return its number.

        Raises DataError (number of signatures, dimension; empty where the stream's distance does not define
        it) and FingerprintError (another model than the items before). A refused item leaves the index as it
        was.
        """
        sides = self._sides(signatures, right=True)
        if not self._stores:
            self._stores = [_Store(s.fingerprint, side) for s, side in zip(signatures, sides, strict=True)]
        for store, side in zip(self._stores, sides, strict=True):
            store.append(side)
        return len(self) - 1

    def query(
        self, signatures: Sequence[Signature], k: int = 1, limit: int | None = None, *, relaxed: bool = False
    ) -> list[IndexMatch]:
        """The k nearest items below number ``limit`` (all when None), best first, equal ones by number.

        ``relaxed`` takes the lower bound itself for the distance and solves no EMD. Raises as `add`,
        SettingsError for k < 1 or a negative limit, ConvergenceError.
        """
        if k < 1:
            raise SettingsError(f"query: expected k >= 1, got {k}")
        search = self._search(signatures, limit)
        best = search.relaxed_nearest(k) if relaxed else search.nearest(k)
        self.statistics = search.statistics()
        found = [IndexMatch(i, distance, shift) for i, (distance, shift) in best.items()]
        return sorted(found, key=lambda match: (match.distance, match.id))[:k]

    def distances(
        self, signatures: Sequence[Signature], limit: int | None = None, *, relaxed: bool = False
    ) -> FloatArray:
        """Exact distances (n,) of the items below ``limit``, or lower bounds if ``relaxed``.

        Raises as `query`.
        """
        search = self._search(signatures, limit)
        best = search.bounds.min(axis=1) if relaxed else search.all_exact()
        self.statistics = search.statistics()
        return best

    def distances_of(
        self, signatures: Sequence[Signature], items: IntArray, *, relaxed: bool = False
    ) -> FloatArray:
        """Exact distances (m,) of some items (m,), or lower bounds if ``relaxed``.

        Raises as `query`, and DataError for an item that is not there.
        """
        chosen = np.asarray(items, dtype=np.int64)
        if chosen.ndim != 1 or (len(chosen) and not 0 <= chosen.min() <= chosen.max() < len(self)):
            raise DataError(f"distances_of: expected items (m,) among the {len(self)} there are")
        sides = self._sides(signatures, right=False)
        stores = [store.taken(chosen) for store in self._stores]
        search = _Search(self.streams, self._shifts, stores, sides, len(chosen))
        best = search.bounds.min(axis=1) if relaxed else search.all_exact()
        self.statistics = search.statistics()
        return best

    def _search(self, signatures: Sequence[Signature], limit: int | None) -> _Search:
        if limit is not None and limit < 0:
            raise SettingsError(f"query: expected limit >= 0, got {limit}")
        sides = self._sides(signatures, right=False)
        count = len(self) if limit is None else min(limit, len(self))
        return _Search(self.streams, self._shifts, self._stores, sides, count)

    def _sides(self, signatures: Sequence[Signature], *, right: bool) -> list[Side]:
        """Validate an item against the streams and the items before it; its arrays in the kernels' layout."""
        if len(signatures) != len(self.streams):
            raise DataError(
                f"SignatureIndex: expected {len(self.streams)} signatures, one a stream, "
                f"got {len(signatures)}"
            )
        sides = []
        for s, (stream, signature) in enumerate(zip(self.streams, signatures, strict=True)):
            d = signature.points.shape[1]
            name, dims = (self._stores[s].fingerprint, self._stores[s].dims) if self._stores else ("", d)
            check_alike(
                name if self._stores else signature.fingerprint, dims, signature.fingerprint, d, stream.ground
            )
            side = side_arrays(SignatureBatch.stack([signature]), stream.masses, stream.ground, right=right)
            if stream.form is None and stream.masses != "null":
                refuse_empty(side.masses, side.masses, stream.masses)
            sides.append(side)
        return sides


class _Store:
    """Growing arrays of one stream, in the layout of the kernels' right side."""

    def __init__(self, fingerprint: str, first: Side) -> None:
        self.fingerprint = fingerprint
        self.dims = first.points.shape[1]
        self.count = 0
        self.side = _empty_side(8, first.weights.shape[1], self.dims)

    def append(self, item: Side) -> None:
        capacity, k = self.side.weights.shape
        clusters = item.weights.shape[1]
        if self.count == capacity or clusters > k:
            grown = _empty_side(
                2 * capacity if self.count == capacity else capacity, max(k, clusters), self.dims
            )
            n = self.count
            grown.weights[:n, :k] = self.side.weights[:n]
            grown.points[:n, :, :k] = self.side.points[:n]
            for new, old in zip(grown[2:], self.side[2:], strict=True):
                new[:n] = old[:n]
            self.side = grown
        self.side.weights[self.count, :clusters] = item.weights[0]
        self.side.points[self.count, :, :clusters] = item.points[0]
        for array, value in zip(self.side[2:], item[2:], strict=True):
            array[self.count] = value[0]
        self.count += 1

    def taken(self, items: IntArray) -> _Store:
        """A store of some of the items."""
        store = _Store.__new__(_Store)
        store.fingerprint, store.dims, store.count = self.fingerprint, self.dims, len(items)
        side = self.side
        store.side = side._replace(
            weights=side.weights[items],
            points=side.points[items],
            counts=side.counts[items],
            masses=side.masses[items],
            complexity=side.complexity[items],
        )
        return store


def _empty_side(capacity: int, k: int, dims: int) -> Side:
    from depthprint._kernels.bounds import Side

    return Side(
        np.zeros((capacity, k)),
        np.zeros((capacity, dims, k)),
        np.zeros(capacity, dtype=np.int64),
        np.zeros(capacity),
        np.zeros(capacity),
    )


class _Search:
    """One query: bounds of all (item, shift) pairs, and the exact distances solved so far."""

    def __init__(
        self,
        streams: Sequence[StreamDistance],
        shifts: Sequence[FloatArray],
        stores: Sequence[_Store],
        sides: Sequence[Side],
        count: int,
    ) -> None:
        from depthprint._kernels.bounds import relaxed_bounds

        self._streams, self._shifts, self._stores, self._sides = streams, shifts, stores, sides
        self._rules = [pair_rules(s.masses, s.form, s.ground) for s in streams]
        self._count, self._solved = count, 0
        self._parts: list[FloatArray] = []
        for s, store in enumerate(stores):
            part = relaxed_bounds(sides[s], store.side, count, shifts[s], self._rules[s])
            self._parts.append(streams[s].weight * part)
        self.bounds = np.zeros((count, len(shifts[0])))
        for part in self._parts:
            self.bounds += part

    def statistics(self) -> QueryStatistics:
        return QueryStatistics(self._count, self.bounds.size * len(self._parts), self._solved)

    def relaxed_nearest(self, k: int) -> dict[int, tuple[float, int]]:
        """Least (bound, shift) of the k items of least bound."""
        least = self.bounds.min(axis=1)
        chosen = np.argsort(least, kind="stable")[:k]
        return {int(i): (float(least[i]), int(self.bounds[i].argmin())) for i in chosen}

    def nearest(self, k: int) -> dict[int, tuple[float, int]]:
        """Best (distance, shift) of items, the k nearest certainly among them."""
        best: dict[int, tuple[float, int]] = {}
        threshold = np.inf
        for pairs in self._in_bound_order():
            if self.bounds.flat[pairs[0]] > threshold:
                break
            pairs = pairs[self.bounds.flat[pairs] <= threshold]
            items, shifts = np.divmod(pairs, self.bounds.shape[1])
            exact = self._exact(items, shifts, np.full(len(pairs), threshold))
            for item, shift, distance in zip(items.tolist(), shifts.tolist(), exact.tolist(), strict=True):
                if np.isfinite(distance):
                    best[item] = min(best.get(item, (np.inf, -1)), (distance, shift))
            if len(best) >= k:
                values = np.array([distance for distance, _ in best.values()])
                threshold = float(np.partition(values, k - 1)[k - 1]) * _ROUNDING
        return best

    def all_exact(self) -> FloatArray:
        """Least exact distance of every item; per item, shifts in the order of their bounds."""
        best = np.full(self._count, np.inf)
        ranked = np.argsort(self.bounds, axis=1, kind="stable")
        for rank in range(ranked.shape[1]):
            shifts = ranked[:, rank]
            items = np.flatnonzero(self.bounds[np.arange(self._count), shifts] <= best * _ROUNDING)
            exact = self._exact(items, shifts[items], best[items] * _ROUNDING)
            best[items] = np.minimum(best[items], exact)
        return best

    def _in_bound_order(self) -> Iterator[IntArray]:
        """Batches of flat (item, shift) pairs by rising bound; only a first few are sorted at first."""
        flat = self.bounds.ravel()
        if not len(flat):
            return
        head = min(_FIRST_SORTED, len(flat))
        start, size = 0, _FIRST_BATCH
        chosen = np.argpartition(flat, head - 1)[:head]
        order = chosen[np.argsort(flat[chosen], kind="stable")]
        while start < len(flat):
            if start + size > len(order) and head < len(flat):
                # a second sort may order equal bounds otherwise, so what was handed out stays in front
                rest = np.argsort(flat, kind="stable")
                order = np.concatenate([order, rest[~np.isin(rest, order)]])
                head = len(flat)
            yield order[start : start + size]
            start += size
            size = min(2 * size, _LARGEST_BATCH)

    def _exact(self, items: IntArray, shifts: IntArray, above: FloatArray) -> FloatArray:
        """Exact combined distances; inf where the streams solved so far already put a pair over ``above``."""
        from depthprint._kernels.bounds import pair_distances

        total = np.zeros(len(items))
        rest = self.bounds[items, shifts]
        alive = np.arange(len(items))
        for s, store in enumerate(self._stores):
            if not len(alive):
                break
            chosen = items[alive], shifts[alive]
            values, status, solved = pair_distances(
                self._sides[s], store.side, *chosen, self._shifts[s], self._rules[s]
            )
            check_status(status)
            self._solved += int(solved.sum())
            total[alive] += self._streams[s].weight * values
            rest[alive] = np.maximum(rest[alive] - self._parts[s][chosen], 0.0)
            alive = alive[total[alive] + rest[alive] <= above[alive] * _ROUNDING]
        result = np.full(len(items), np.inf)
        result[alive] = total[alive]
        return result
