"""Growing arrays of one stream of an index: signatures, and the boxes that bound the distances of neighbouring ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from depthprint.signature import GroundDistance

if TYPE_CHECKING:
    from depthprint._kernels.ground import Side
    from depthprint._kernels.lane_bounds import Items

__all__ = [
    "ITEMS_PER_BLOCK",
    "ITEMS_PER_GROUP",
    "SignatureStore",
    "float32_holds",
    "summary_slack",
    "summary_vectors",
]

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]
_Number = TypeVar("_Number", bound=np.generic)

ITEMS_PER_BLOCK = 32
ITEMS_PER_GROUP = 16
_DOUBLES_UP_TO = 1 << 14
_FLOAT32_LIMIT = 1e12
_BY_ITEM = ("weights", "whole_points", "rest", "scales", "errors", "counts", "masses", "complexity")
_ITEMS_AT_ONCE = 4096
_NO_POINTS = np.zeros((0, 0, 0), np.float32)


class SignatureStore:
    """Items 0..count-1. Numbers that float32 holds without loss are kept in float32, else all in float64.

    Points are split into codes, which lie as `depthprint._kernels.codes` reads them, and rests, as long as
    `depthprint._kernels.split_points` loses nothing; then the rests are (n, d, k, 0) and the points kept whole,
    beside the codes. Weights (n, k) are left out, (n, 0), while all clusters have one. The arrays may have
    spare rows beyond ``count``. Adding costs amortised constant time; large arrays grow by a small share in
    place, so that memory stays near what the items need.
    """

    def __init__(self, fingerprint: str, dims: int, ground: GroundDistance) -> None:
        self.fingerprint = fingerprint
        self.dims = dims
        self.count = 0
        self.largest_norm = 0.0
        self._ground = ground
        appearance = dims - ground.position_dims
        self.common_weight = 0.0
        self.weights: npt.NDArray[np.floating] = np.zeros((0, 0), np.float32)
        self.whole_points: npt.NDArray[np.floating] = np.zeros((0, dims, 0), np.float32)
        self.rest: npt.NDArray[np.uint8] = np.zeros((0, dims, 1, 3), np.uint8)
        self.codes: npt.NDArray[np.uint8] = np.zeros((0, 1, -(-dims // 4), ITEMS_PER_GROUP, 4), np.uint8)
        self.scales: Float32Array = np.zeros(0, np.float32)
        self.errors: Float32Array = np.zeros(0, np.float32)
        self.counts: IntArray = np.zeros(0, np.int64)
        self.masses: FloatArray = np.zeros(0)
        self.complexity: FloatArray = np.zeros(0)
        self.low: Float32Array = np.zeros((0, appearance), np.float32)
        self.high: Float32Array = np.zeros((0, appearance), np.float32)
        self.mass_range: FloatArray = np.zeros((0, 2))
        self.largest_complexity: FloatArray = np.zeros(0)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(value.nbytes for value in vars(self).values() if isinstance(value, np.ndarray))

    @property
    def points(self) -> npt.NDArray[np.floating]:
        """Points (groups, k, dims, ITEMS_PER_GROUP) in the precision that holds them; 0 beyond the last item."""
        k = self.codes.shape[1]
        points = np.zeros((len(self.codes) * ITEMS_PER_GROUP, self.dims, k), self.whole_points.dtype)
        points[: self.count] = self.gather(np.arange(self.count)).points
        return points.reshape(-1, ITEMS_PER_GROUP, self.dims, k).transpose(0, 3, 2, 1)

    def append(self, items: Side) -> None:
        """Add all signatures of a right side."""
        first, added = self.count, len(items.counts)
        k = items.weights.shape[1]
        self._keep_weights(items)
        self._make_room(first + added, k)
        last = first + added
        self._keep_precision(items)
        if self.weights.shape[1]:
            self.weights[first:last, :k] = items.weights
            self.weights[first:last, k:] = 0.0
        if not self._split(items):
            self._keep_whole()
            self._keep_precision(items)
            self._split(items)
        if not self.rest.shape[3]:
            self.whole_points[first:last, :, :k] = items.points
            self.whole_points[first:last, :, k:] = 0.0
        self.counts[first:last] = items.counts
        self.masses[first:last] = items.masses
        self.complexity[first:last] = items.complexity
        self.count = last
        self._update_blocks(items, first)

    def _split(self, items: Side) -> bool:
        """Codes, rests, scales and errors of items that follow; False where rests cannot hold them."""
        from depthprint._kernels.split_points import split_items

        return bool(
            split_items(
                items.points, items.counts, self.count, self.codes, self.rest, self.scales, self.errors
            )
        )

    def items(self, count: int, *, codes_alone: bool = False) -> Items:
        """The first items as the kernels take them, without points where their codes suffice."""
        from depthprint._kernels.lane_bounds import Items

        arrays = (self.counts[:count], self.masses[:count], self.complexity[:count])
        whole = _NO_POINTS if codes_alone else self.whole_points  # of one type: kernels compile once
        points = (self.codes, self.rest, self.scales, self.errors, whole)
        return Items(*points, self.weights, self.common_weight, *arrays)

    def gather(self, items: IntArray) -> Side:
        """Chosen items in the exact kernels' layout."""
        from depthprint._kernels.ground import Side
        from depthprint._kernels.lane_bounds import gather_items

        weights, points = gather_items(self.items(self.count), items)
        return Side(weights, points, self.counts[items], self.masses[items], self.complexity[items])

    def _make_room(self, needed: int, clusters: int) -> None:
        k = self.codes.shape[1]
        capacity = len(self.counts)
        if clusters > k:
            self.codes = _widened(self.codes, 1, clusters)
            self.rest = _widened(self.rest, 2, clusters)
            if not self.rest.shape[3]:
                self.whole_points = _widened(self.whole_points, 2, clusters)
            if self.weights.shape[1]:
                self.weights = _widened(self.weights, 1, clusters)
        if needed > capacity:
            spare = capacity if capacity < _DOUBLES_UP_TO else capacity // 128
            groups = -(-max(needed, capacity + spare) // ITEMS_PER_GROUP)
            rows = groups * ITEMS_PER_GROUP
            for name in _BY_ITEM:
                _grow(getattr(self, name), rows)
            _grow(self.codes, groups)
            blocks = -(-rows // ITEMS_PER_BLOCK)
            for name in ("low", "high", "mass_range", "largest_complexity"):
                _grow(getattr(self, name), blocks)

    def _keep_weights(self, items: Side) -> None:
        """Write the weights out once they are not all the same."""
        if self.weights.shape[1]:
            return
        present = np.arange(items.weights.shape[1]) < items.counts[:, None]
        weights = items.weights[present]
        if len(weights) and not self.counts[: self.count].any():
            self.common_weight = float(weights[0])
        if (weights != self.common_weight).any():
            columns = np.arange(self.codes.shape[1])
            written = np.where(columns < self.counts[:, None], self.common_weight, 0.0)
            written[self.count :] = 0.0
            self.weights = written.astype(np.float32) if _in_float32(written) else written

    def _keep_whole(self) -> None:
        """Join the points once some cannot be split."""
        points = np.zeros((len(self.counts), *self.rest.shape[1:3]), np.float32)
        for start in range(0, self.count, _ITEMS_AT_ONCE):
            some = np.arange(start, min(start + _ITEMS_AT_ONCE, self.count))
            points[some] = self.gather(some).points
        self.whole_points, self.rest = points, np.zeros((*self.rest.shape[:3], 0), np.uint8)

    def _keep_precision(self, items: Side) -> None:
        for name, exact in (("weights", items.weights), ("whole_points", items.points)):
            array = getattr(self, name)
            if array.size and array.dtype == np.float32 and not _in_float32(exact):
                setattr(self, name, array.astype(np.float64))

    def _update_blocks(self, items: Side, first: int) -> None:
        """Boxes around the summary vectors of new items; that of the first of them may have older items in it."""
        vectors, largest = summary_vectors(items.weights, items.points, self._ground)
        self.largest_norm = max(self.largest_norm, largest)
        last = first + len(vectors)
        for block in range(first // ITEMS_PER_BLOCK, -(-last // ITEMS_PER_BLOCK)):
            start = max(block * ITEMS_PER_BLOCK, first)
            some = slice(start - first, min((block + 1) * ITEMS_PER_BLOCK, last) - first)
            masses = items.masses[some].min(), items.masses[some].max()
            box = (vectors[some].min(axis=0), vectors[some].max(axis=0))
            complexity = items.complexity[some].max()
            if start > block * ITEMS_PER_BLOCK:
                box = (np.minimum(self.low[block], box[0]), np.maximum(self.high[block], box[1]))
                lightest, heaviest = self.mass_range[block]
                masses = (min(lightest, masses[0]), max(heaviest, masses[1]))
                complexity = max(complexity, self.largest_complexity[block])
            self.low[block], self.high[block] = box
            self.mass_range[block] = masses
            self.largest_complexity[block] = complexity


def summary_vectors(
    weights: npt.NDArray[np.floating], points: npt.NDArray[np.floating], ground: GroundDistance
) -> tuple[Float32Array, float]:
    """Vectors (n, a) of `depthprint._kernels.summaries`, and the largest norm of a point (n, d, k)."""
    appearance = points[:, : points.shape[1] - ground.position_dims]
    radius = 0.5 * ground.cap
    with np.errstate(over="ignore", invalid="ignore"):
        norms = np.sqrt(np.einsum("ndk,ndk->nk", appearance, appearance))
        scale = np.where(norms > radius, radius / np.where(norms > 0, norms, 1.0), 1.0)
        vectors = np.einsum("nk,ndk->nd", weights * scale, appearance).astype(np.float32)
        largest = np.sqrt(np.einsum("ndk,ndk->nk", points, points)).max(initial=0.0)
    return vectors, float(largest)


def summary_slack(ground: GroundDistance) -> float:
    """More than the rounding of a summary vector in float32, for a unit of mass."""
    return 0.5e-6 * ground.cap


def float32_holds(mass: float, norm: float, ground: GroundDistance) -> bool:
    """Whether float32 holds all that the cheap bounds add up, for masses and points up to these."""
    return max(mass, mass * ground.cap, norm) < _FLOAT32_LIMIT


def _widened(array: npt.NDArray[_Number], axis: int, width: int) -> npt.NDArray[_Number]:
    shape = list(array.shape)
    shape[axis] = width
    wide = np.zeros(shape, array.dtype)
    wide[tuple(slice(0, length) for length in array.shape)] = array
    return wide


def _in_float32(exact: FloatArray) -> bool:
    with np.errstate(over="ignore"):
        return np.array_equal(exact.astype(np.float32), exact)


def _grow(array: npt.NDArray[np.generic], rows: int) -> None:
    """Lengthen an array that nothing else refers to, in place where the allocator can."""
    array.resize((rows, *array.shape[1:]), refcheck=False)
