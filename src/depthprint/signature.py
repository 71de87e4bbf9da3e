"""Signatures: weighted points in a ground space (paper eq. 9-10), one by one and in batches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, FingerprintError, SettingsError

__all__ = ["GroundDistance", "Signature", "SignatureBatch"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class GroundDistance:
    """Distance between two cluster points, and to the null element {0} of eq. 18.

    c(p, q) = min(||p - q||_2, cap): Euclidean over all coordinates. The last ``position_dims`` coordinates
    are positions, already scaled by their weight; a shift search adds an offset to them. With ``period`` the
    first position coordinate is circular: its difference is taken modulo ``period``.
    ``null_cost`` is the cost of moving a unit of mass to or from the null element. ``cap`` is at most twice
    ``null_cost``, since mass may always go by way of the null element.
    """

    cap: float = 2.0
    null_cost: float = 1.0
    position_dims: int = 0
    period: float | None = None

    def __post_init__(self) -> None:
        if not 0 < self.cap <= 2 * self.null_cost:
            raise SettingsError(
                f"GroundDistance: expected 0 < cap <= 2 null_cost, got {self.cap}, {self.null_cost}"
            )
        if self.period is not None and (self.position_dims < 1 or not self.period > 0):
            raise SettingsError(
                "GroundDistance: a period must be positive and needs at least one position dimension"
            )


@dataclass(frozen=True)
class Signature:
    """Clusters of one image: ``weights`` (k,) >= 0 and ``points`` (k, d), float64, read-only (eq. 9).

    ``fingerprint`` names the dictionary and settings that made it; only equal fingerprints compare.
    """

    weights: FloatArray
    points: FloatArray
    fingerprint: str = ""

    def __post_init__(self) -> None:
        weights = np.array(self.weights, dtype=np.float64)
        points = np.array(self.points, dtype=np.float64)
        if weights.ndim != 1 or points.ndim != 2 or len(weights) != len(points):
            raise DataError(
                f"Signature: expected weights (k,) and points (k, d), got {weights.shape} and {points.shape}"
            )
        if not (np.isfinite(weights).all() and np.isfinite(points).all()):
            raise DataError("Signature: weights and points must be finite")
        if (weights < 0).any():
            raise DataError(f"Signature: weights must be >= 0, got {weights.min():g}")
        for name, array in (("weights", weights), ("points", points)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.weights)

    @property
    def mass(self) -> float:
        """Total weight."""
        return float(self.weights.sum())


@dataclass(frozen=True)
class SignatureBatch:
    """Signatures of n images, padded: ``weights`` (n, k), ``points`` (n, k, d) float64, ``counts`` (n,) int64.

    Rows beyond ``counts[i]`` hold zero weight and zero points.
    """

    weights: FloatArray
    points: FloatArray
    counts: npt.NDArray[np.int64]
    fingerprint: str = ""

    def __len__(self) -> int:
        return len(self.weights)

    def __getitem__(self, index: int) -> Signature:
        n = int(self.counts[index])
        return Signature(self.weights[index, :n], self.points[index, :n], self.fingerprint)

    @classmethod
    def stack(cls, signatures: Sequence[Signature]) -> SignatureBatch:
        """Pad signatures to one batch; all must share fingerprint and point dimension."""
        if not signatures:
            raise DataError("SignatureBatch.stack: expected at least one signature, got none")
        first = signatures[0]
        d = first.points.shape[1]
        k = max(1, max(len(s) for s in signatures))
        weights = np.zeros((len(signatures), k))
        points = np.zeros((len(signatures), k, d))
        counts = np.zeros(len(signatures), dtype=np.int64)
        for i, s in enumerate(signatures):
            if s.fingerprint != first.fingerprint:
                raise FingerprintError(
                    f"signature {i}: made by {s.fingerprint!r}, expected {first.fingerprint!r}; "
                    "signatures of different models cannot be compared"
                )
            if s.points.shape[1] != d:
                raise DataError(f"signature {i}: expected points of dimension {d}, got {s.points.shape[1]}")
            weights[i, : len(s)] = s.weights
            points[i, : len(s)] = s.points
            counts[i] = len(s)
        for array in (weights, points, counts):
            array.setflags(write=False)
        return cls(weights, points, counts, first.fingerprint)
