"""Growing arrays of one stream of an index: signatures, and the short vectors that bound their distances."""

from __future__ import annotations

from typing import TYPE_CHECKING

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

ITEMS_PER_BLOCK = 32
ITEMS_PER_GROUP = 16
_DOUBLES_UP_TO = 1 << 14
_FLOAT32_LIMIT = 1e12
_BY_ITEM = ("weights", "item_points", "scales", "errors", "counts", "masses", "complexity", "vectors")


class SignatureStore:
    """Items 0..count-1. Numbers that float32 holds without loss are kept in float32, else all in float64.

    Codes lie as `depthprint._kernels.codes` reads them, ITEMS_PER_GROUP neighbouring items side by side; all else
    an item after the other. Weights (n, k) are left out, (n, 0), while all clusters have one. The arrays may have
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
        self.item_points: npt.NDArray[np.floating] = np.zeros((0, dims, 1), np.float32)
        self.codes: npt.NDArray[np.uint8] = np.zeros((0, 1, -(-dims // 4), ITEMS_PER_GROUP, 4), np.uint8)
        self.scales: Float32Array = np.zeros(0, np.float32)
        self.errors: Float32Array = np.zeros(0, np.float32)
        self.counts: IntArray = np.zeros(0, np.int64)
        self.masses: FloatArray = np.zeros(0)
        self.complexity: FloatArray = np.zeros(0)
        self.vectors: Float32Array = np.zeros((0, appearance), np.float32)
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
        """View (groups, k, dims, ITEMS_PER_GROUP) of the points."""
        groups = (-1, ITEMS_PER_GROUP, *self.item_points.shape[1:])
        return self.item_points.reshape(groups).transpose(0, 3, 2, 1)

    def append(self, items: Side) -> None:
        """Add all signatures of a right side."""
        from depthprint._kernels.codes import code_items

        first, added = self.count, len(items.counts)
        k = items.weights.shape[1]
        self._keep_weights(items)
        self._make_room(first + added, k)
        last = first + added
        self._keep_precision(items)
        if self.weights.shape[1]:
            self.weights[first:last, :k] = items.weights
            self.weights[first:last, k:] = 0.0
        self.item_points[first:last, :, :k] = items.points
        self.item_points[first:last, :, k:] = 0.0
        code_items(items.points, items.counts, first, self.codes, self.scales, self.errors)
        self.counts[first:last] = items.counts
        self.masses[first:last] = items.masses
        self.complexity[first:last] = items.complexity
        vectors, largest = summary_vectors(items.weights, items.points, self._ground)
        self.vectors[first:last] = vectors
        self.largest_norm = max(self.largest_norm, largest)
        self.count = last
        self._update_blocks(first, last)

    def items(self, count: int) -> Items:
        """The first items as the kernels take them."""
        from depthprint._kernels.lane_bounds import Items

        arrays = (self.counts[:count], self.masses[:count], self.complexity[:count])
        return Items(self.item_points, self.weights, self.common_weight, *arrays)

    def gather(self, items: IntArray) -> Side:
        """Chosen items in the exact kernels' layout."""
        from depthprint._kernels.ground import Side
        from depthprint._kernels.lane_bounds import gather_items

        weights, points = gather_items(self.items(self.count), items)
        return Side(weights, points, self.counts[items], self.masses[items], self.complexity[items])

    def _make_room(self, needed: int, clusters: int) -> None:
        k = self.item_points.shape[2]
        capacity = len(self.counts)
        if clusters > k:
            points = np.zeros((capacity, self.dims, clusters), self.item_points.dtype)
            codes = np.zeros((len(self.codes), clusters, *self.codes.shape[2:]), np.uint8)
            points[..., :k], codes[:, :k] = self.item_points, self.codes
            self.item_points, self.codes = points, codes
            if self.weights.shape[1]:
                weights = np.zeros((capacity, clusters), self.weights.dtype)
                weights[:, :k] = self.weights
                self.weights = weights
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
            columns = np.arange(self.item_points.shape[2])
            written = np.where(columns < self.counts[:, None], self.common_weight, 0.0)
            written[self.count :] = 0.0
            self.weights = written.astype(np.float32) if _in_float32(written) else written

    def _keep_precision(self, items: Side) -> None:
        for name, exact in (("weights", items.weights), ("item_points", items.points)):
            array = getattr(self, name)
            if array.size and array.dtype == np.float32 and not _in_float32(exact):
                setattr(self, name, array.astype(np.float64))

    def _update_blocks(self, first: int, last: int) -> None:
        for block in range(first // ITEMS_PER_BLOCK, (last - 1) // ITEMS_PER_BLOCK + 1):
            members = slice(block * ITEMS_PER_BLOCK, min((block + 1) * ITEMS_PER_BLOCK, last))
            if members.stop - members.start > 1 and last - first == 1:
                members = slice(first, last)
                self.low[block] = np.minimum(self.low[block], self.vectors[first])
                self.high[block] = np.maximum(self.high[block], self.vectors[first])
                mass = self.masses[first]
                self.mass_range[block] = (
                    min(self.mass_range[block, 0], mass),
                    max(self.mass_range[block, 1], mass),
                )
                self.largest_complexity[block] = max(self.largest_complexity[block], self.complexity[first])
                continue
            self.low[block] = self.vectors[members].min(axis=0)
            self.high[block] = self.vectors[members].max(axis=0)
            self.mass_range[block] = self.masses[members].min(), self.masses[members].max()
            self.largest_complexity[block] = self.complexity[members].max()


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


def _in_float32(exact: FloatArray) -> bool:
    with np.errstate(over="ignore"):
        return np.array_equal(exact.astype(np.float32), exact)


def _grow(array: npt.NDArray[np.generic], rows: int) -> None:
    """Lengthen an array that nothing else refers to, in place where the allocator can."""
    array.resize((rows, *array.shape[1:]), refcheck=False)
