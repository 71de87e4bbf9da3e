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

__all__ = [
    "DistanceFeatures",
    "code_features",
    "code_vectors",
    "mirrored_encodings",
    "picture_distances",
    "unit_rows",
]

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]


def code_vectors(encoder: Encoder, encodings: Sequence[Encoding]) -> Float32Array:
    """Unit vectors (n, d) of the pooled codes of the streams, each with its weight.

    Streams of pairs of points are left out: the recogniser compares those by themselves.
    """
    streams = encoder.settings.streams
    chosen = [number for number, stream in enumerate(streams) if stream.view != "pairs"] or range(
        len(streams)
    )
    total = sum(streams[number].weight for number in chosen)
    return np.concatenate(
        [
            np.float32(math.sqrt(streams[number].weight / total))
            * unit_rows(np.stack([e.vectors[number].reshape(-1) for e in encodings]))
            for number in chosen
        ],
        axis=1,
    )


def picture_distances(encoder: Encoder, encodings: Sequence[Encoding]) -> MirroredDistances:
    """One minus the cosines (n, n) of the views' ``code_vectors``."""
    vectors = code_vectors(encoder, encodings)
    straight = np.maximum(1.0 - vectors @ vectors.T, 0.0)
    if not encoder.settings.mirror:
        return MirroredDistances(straight)
    crossed = code_vectors(encoder, mirrored_encodings(encodings)) @ vectors.T
    return MirroredDistances(straight, np.maximum(1.0 - (crossed + crossed.T) / 2, 0.0))


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
