"""Kernels between the views of objects: of the pooled codes, and of the information distance."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.errors import DataError
from depthprint.objects.distances import MirroredDistances
from depthprint.settings import EncoderSettings

__all__ = [
    "DistanceFeatures",
    "code_features",
    "code_vectors",
    "mirrored_encodings",
    "picture_shares",
    "unit_rows",
]

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]


def picture_shares(settings: EncoderSettings) -> dict[int, float]:
    """Shares, by their numbers, of the streams whose codes the recogniser compares: all but those of pairs of points.

    Pairs are compared by themselves. Where there is nothing else, all streams.
    """
    pictures = {number: s.weight for number, s in enumerate(settings.streams) if s.view != "pairs"}
    chosen = pictures or {number: s.weight for number, s in enumerate(settings.streams)}
    return {number: weight / sum(chosen.values()) for number, weight in chosen.items()}


def code_vectors(encoder: Encoder, encodings: Sequence[Encoding]) -> Float32Array:
    """Unit vectors (n, d) of the pooled codes of the streams of ``picture_shares``."""
    return np.concatenate(
        [
            np.float32(math.sqrt(share))
            * unit_rows(np.stack([e.vectors[number].reshape(-1) for e in encodings]))
            for number, share in picture_shares(encoder.settings).items()
        ],
        axis=1,
    )


def mirrored_encodings(encodings: Sequence[Encoding]) -> list[Encoding]:
    """Encodings of the mirrored views; empty where the preset does not mirror."""
    return [e.mirrored for e in encodings if e.mirrored is not None]


def code_features(encoder: Encoder, encodings: Sequence[Encoding]) -> Float32Array:
    """Unit vectors (n, d) whose products are the kernel of the pooled codes.

    Where the preset mirrors, the codes of a view and of its mirror image are added: a kernel of such sums is positive
    semi-definite, and all but the same for a view and its mirror image.
    """
    vectors = code_vectors(encoder, encodings)
    if encoder.settings.mirror:
        vectors += code_vectors(encoder, mirrored_encodings(encodings))
    return unit_rows(vectors)


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
        return unit_rows(queries.gaussian_kernel(self.scale) @ self.basis)


def unit_rows(rows: npt.NDArray[np.floating]) -> Float32Array:
    """Each row scaled to length 1."""
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9), dtype=np.float32)
