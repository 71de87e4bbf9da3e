"""Kernels between the views of objects: of the pooled codes, and of the information distance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.errors import DataError
from depthprint.object_distances import MirroredDistances

__all__ = ["DistanceFeatures", "code_features"]

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]


def code_features(encoder: Encoder, encodings: Sequence[Encoding]) -> Float32Array:
    """Unit vectors (n, d) whose products are the kernel of the pooled codes, each stream with its weight.

    Where the preset mirrors, the codes of a view and of its mirror image are added: the features of both are the same
    but for the places of the cells, and a kernel of sums over both is positive semi-definite.
    """
    columns = []
    for number, weight in enumerate(encoder.settings.stream_weights):
        rows = np.stack(
            [
                e.vectors[number] if e.mirrored is None else e.vectors[number] + e.mirrored.vectors[number]
                for e in encodings
            ]
        ).reshape(len(encodings), -1)
        columns.append(np.sqrt(weight) * _unit_rows(rows))
    return _unit_rows(np.concatenate(columns, axis=1))


class DistanceFeatures:
    """Unit vectors whose products are close to the kernel exp(-d^2 / median d^2) of the distances to landmarks.

    The kernel sums over a view and its mirror image. It is not positive semi-definite; what its negative eigenvalues
    span is left out, and landmarks stand for all views (Nystroem's method: exact where every view is one).
    """

    def __init__(self, landmarks: MirroredDistances) -> None:
        distances = landmarks.straight
        n = len(distances)
        if distances.shape != (n, n) or n < 2:
            raise DataError(
                f"DistanceFeatures: expected distances (n, n) of two views or more, got {distances.shape}"
            )
        self.scale = max(float(np.median(distances[~np.eye(n, dtype=bool)] ** 2)), 1e-12)
        kernel = landmarks.gaussian_kernel(self.scale)
        values, vectors = np.linalg.eigh((kernel + kernel.T) / 2)
        positive = values > 1e-6 * values[-1]
        self.basis = vectors[:, positive] / np.sqrt(values[positive])

    @classmethod
    def restored(cls, scale: float, basis: FloatArray) -> DistanceFeatures:
        """The features with a scale and basis (n_landmarks, r) learned before."""
        features = cls.__new__(cls)
        features.scale, features.basis = scale, basis
        return features

    def of(self, queries: MirroredDistances) -> Float32Array:
        """Features (m, r) from distances (m, n_landmarks)."""
        return _unit_rows(queries.gaussian_kernel(self.scale) @ self.basis)


def _unit_rows(rows: npt.NDArray[np.floating]) -> Float32Array:
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9), dtype=np.float32)
