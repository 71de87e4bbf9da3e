"""Growing arrays of one stream of an index: signatures, and the short vectors that bound their distances."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint.signature import GroundDistance

if TYPE_CHECKING:
    from depthprint._kernels.ground import Side

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


class SignatureStore:
    """Items 0..count-1. Numbers that float32 holds without loss are kept in float32, else all in float64.

    Points (groups, k, dims, ITEMS_PER_GROUP) and weights (groups, k, ITEMS_PER_GROUP) lie as
    `depthprint._kernels.sweep` reads them: the same number of neighbouring items side by side. The arrays may
    have spare rows beyond ``count``. Adding costs amortised constant time; large arrays grow by a small share
    in place, so that memory stays near what the items need.
    """

    def __init__(self, fingerprint: str, dims: int, ground: GroundDistance) -> None:
        self.fingerprint = fingerprint
        self.dims = dims
        self.count = 0
        self.largest_norm = 0.0
        self._ground = ground
        appearance = dims - ground.position_dims
        self.weights: npt.NDArray[np.floating] = np.zeros((0, 1, ITEMS_PER_GROUP), np.float32)
        self.points: npt.NDArray[np.floating] = np.zeros((0, 1, dims, ITEMS_PER_GROUP), np.float32)
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

    def append(self, items: Side) -> None:
        """Add all signatures of a right side."""
        first, added = self.count, len(items.counts)
        k = items.weights.shape[1]
        self._make_room(first + added, k)
        last = first + added
        self._keep_precision(items)
        group, lane = np.divmod(np.arange(first, last), ITEMS_PER_GROUP)
        self.weights[group, :k, lane] = items.weights
        self.weights[group, k:, lane] = 0.0
        self.points[group, :k, :, lane] = items.points.transpose(0, 2, 1)
        self.points[group, k:, :, lane] = 0.0
        self.counts[first:last] = items.counts
        self.masses[first:last] = items.masses
        self.complexity[first:last] = items.complexity
        vectors, largest = summary_vectors(items.weights, items.points, self._ground)
        self.vectors[first:last] = vectors
        self.largest_norm = max(self.largest_norm, largest)
        self.count = last
        self._update_blocks(first, last)

    def gather(self, items: IntArray) -> Side:
        """Chosen items in the exact kernels' layout."""
        from depthprint._kernels.ground import Side
        from depthprint._kernels.sweep import gather_items

        weights, points = gather_items(self.weights, self.points, items)
        return Side(weights, points, self.counts[items], self.masses[items], self.complexity[items])

    def _make_room(self, needed: int, clusters: int) -> None:
        k = self.weights.shape[1]
        if clusters > k:
            groups = len(self.weights)
            weights = np.zeros((groups, clusters, ITEMS_PER_GROUP), self.weights.dtype)
            points = np.zeros((groups, clusters, self.dims, ITEMS_PER_GROUP), self.points.dtype)
            weights[:, :k], points[:, :k] = self.weights, self.points
            self.weights, self.points = weights, points
        capacity = len(self.counts)
        if needed > capacity:
            spare = capacity if capacity < _DOUBLES_UP_TO else capacity // 128
            rows = max(needed, capacity + spare, 8)
            for name in ("counts", "masses", "complexity", "vectors"):
                _grow(getattr(self, name), rows)
            for name in ("weights", "points"):
                _grow(getattr(self, name), -(-rows // ITEMS_PER_GROUP))
            blocks = -(-rows // ITEMS_PER_BLOCK)
            for name in ("low", "high", "mass_range", "largest_complexity"):
                _grow(getattr(self, name), blocks)

    def _keep_precision(self, items: Side) -> None:
        for name in ("weights", "points"):
            array, exact = getattr(self, name), getattr(items, name)
            with np.errstate(over="ignore"):
                if array.dtype == np.float32 and not np.array_equal(exact.astype(np.float32), exact):
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


def _grow(array: npt.NDArray[np.generic], rows: int) -> None:
    """Lengthen an array that nothing else refers to, in place where the allocator can."""
    array.resize((rows, *array.shape[1:]), refcheck=False)
