"""Exact nearest signatures among many, with few EMDs: relaxed bounds propose, exact distances decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from depthprint._pairs import (
    check_alike,
    refuse_empty,
    shift_table,
    side_arrays,
)
from depthprint._signature_store import SignatureStore
from depthprint.errors import DataError, SettingsError
from depthprint.signature import Signature, SignatureBatch
from depthprint.stream_distance import StreamDistance

if TYPE_CHECKING:
    from depthprint._kernels.ground import Side
    from depthprint._nearest_search import NearestSearch

__all__ = ["IndexMatch", "QueryStatistics", "SignatureIndex", "StreamDistance"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


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
        self._stores: list[SignatureStore] = []
        self.statistics = QueryStatistics()

    def __len__(self) -> int:
        return self._stores[0].count if self._stores else 0

    @property
    def nbytes(self) -> int:
        """Bytes held for the items."""
        return sum(store.nbytes for store in self._stores)

    def add(self, signatures: Sequence[Signature]) -> int:
        """Store an item, one signature a stream, and return its number.

        Raises DataError (number of signatures, dimension; empty where the stream's distance does not define
        it) and FingerprintError (another model than the items before). A refused item leaves the index as it
        was.
        """
        return self.extend([SignatureBatch.stack([signature]) for signature in signatures])[0]

    def extend(self, batches: Sequence[SignatureBatch]) -> range:
        """Store many items, one batch a stream with row i of each being one item, and return their numbers.

        Raises as `add`, and DataError for batches of unequal length; then nothing is stored.
        """
        sides = self._sides(batches, right=True)
        if len({len(side.counts) for side in sides}) > 1:
            raise DataError(
                f"SignatureIndex: expected batches of one length, got {[len(side.counts) for side in sides]}"
            )
        if not self._stores:
            self._stores = [
                SignatureStore(batch.fingerprint, batch.points.shape[2], stream.ground)
                for batch, stream in zip(batches, self.streams, strict=True)
            ]
        first = len(self)
        for store, side in zip(self._stores, sides, strict=True):
            store.append(side)
        return range(first, len(self))

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
        if relaxed:
            least, shift = search.relaxed()
            chosen = np.argsort(least, kind="stable")[:k]
            best = {int(i): (float(least[i]), int(shift[i])) for i in chosen}
        else:
            best = search.nearest(k)
        self._note(search)
        found = [IndexMatch(i, distance, shift) for i, (distance, shift) in best.items()]
        return sorted(found, key=lambda match: (match.distance, match.id))[:k]

    def distances(
        self, signatures: Sequence[Signature], limit: int | None = None, *, relaxed: bool = False
    ) -> FloatArray:
        """Exact distances (n,) of the items below ``limit``, or lower bounds if ``relaxed``.

        Raises as `query`.
        """
        search = self._search(signatures, limit)
        best = search.relaxed()[0] if relaxed else search.all_exact()
        self._note(search)
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
        search = self._search(signatures, None)
        best = search.relaxed(chosen)[0] if relaxed else search.all_exact(chosen)
        self._note(search)
        return best

    def _note(self, search: NearestSearch) -> None:
        self.statistics = QueryStatistics(search.count, search.bounds_computed, search.emds_solved)

    def _search(self, signatures: Sequence[Signature], limit: int | None) -> NearestSearch:
        from depthprint._nearest_search import NearestSearch

        if limit is not None and limit < 0:
            raise SettingsError(f"query: expected limit >= 0, got {limit}")
        sides = self._sides([SignatureBatch.stack([signature]) for signature in signatures], right=False)
        count = len(self) if limit is None else min(limit, len(self))
        return NearestSearch(self.streams, self._shifts, self._stores, sides, count)

    def _sides(self, batches: Sequence[SignatureBatch], *, right: bool) -> list[Side]:
        """Validate items against the streams and the items before them; their arrays in the kernels' layout."""
        if len(batches) != len(self.streams):
            raise DataError(
                f"SignatureIndex: expected {len(self.streams)} signatures, one a stream, got {len(batches)}"
            )
        sides = []
        for s, (stream, batch) in enumerate(zip(self.streams, batches, strict=True)):
            d = batch.points.shape[2]
            name, dims = batch.fingerprint, d
            if self._stores:
                name, dims = self._stores[s].fingerprint, self._stores[s].dims
            check_alike(name, dims, batch.fingerprint, d, stream.ground)
            side = side_arrays(batch, stream.masses, stream.ground, right=right)
            if stream.form is None and stream.masses != "null":
                refuse_empty(side.masses, side.masses, stream.masses)
            sides.append(side)
        return sides
