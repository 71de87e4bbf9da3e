"""What a saved recogniser keeps of the views it learned from, and how it compares others with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.object_distances import compare_complexities
from depthprint.object_kernels import DistanceFeatures, code_vectors, mirrored_encodings, unit_rows
from depthprint.object_recogniser import ViewComparison

__all__ = ["MAX_DIRECTIONS", "MAX_LANDMARKS", "StoredViews", "ViewFeatures", "store_views"]

Float32Array = npt.NDArray[np.float32]

MAX_DIRECTIONS = 384
MAX_LANDMARKS = 48


@dataclass(frozen=True)
class ViewFeatures:
    """Views as short vectors, (n, r) each, read-only.

    straight, mirrored: unit pooled codes along the leading directions; ``mirrored`` equals ``straight`` where the
    preset does not mirror. landmark: unit features of the information distance to the landmarks.
    """

    straight: Float32Array
    mirrored: Float32Array
    landmark: Float32Array

    def __post_init__(self) -> None:
        for array in (self.straight, self.mirrored, self.landmark):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.straight)

    def taken(self, rows: npt.NDArray[np.integer]) -> ViewFeatures:
        """Some of the views."""
        return ViewFeatures(self.straight[rows], self.mirrored[rows], self.landmark[rows])

    def compared_with(self, stored: ViewFeatures) -> ViewComparison:
        """Kernel values and distances (m, n) to other views."""
        kernel = unit_rows(self.straight + self.mirrored) @ unit_rows(stored.straight + stored.mirrored).T
        cosine = np.maximum(self.straight @ stored.straight.T, self.mirrored @ stored.straight.T)
        if self is stored:
            cosine = np.maximum(cosine, cosine.T)
        kernel = (kernel + self.landmark @ stored.landmark.T) / 2
        return ViewComparison(kernel, (np.maximum(1.0 - cosine, 0.0),))


@dataclass(frozen=True)
class StoredViews:
    """Directions of the pooled codes (d, r), landmark encodings with their features, and the views learned from."""

    directions: Float32Array
    landmarks: tuple[Encoding, ...]
    distance_features: DistanceFeatures
    views: ViewFeatures

    def describe(self, encoder: Encoder, encodings: Sequence[Encoding]) -> ViewFeatures:
        """Bring encodings of the same encoder into the form of the stored views."""
        straight = unit_rows(code_vectors(encoder, encodings) @ self.directions)
        mirrored = straight
        if encoder.settings.mirror:
            mirrored = unit_rows(code_vectors(encoder, mirrored_encodings(encodings)) @ self.directions)
        distances = compare_complexities(encoder, encodings, self.landmarks)
        return ViewFeatures(straight, mirrored, self.distance_features.of(distances))


def store_views(encoder: Encoder, encodings: Sequence[Encoding], seed: int) -> StoredViews:
    """Learn the leading directions of the views' codes, and choose landmarks evenly among the views.

    Directions are singular vectors of the codes of views and mirror images (randomised, seeded), rounded to the 16 bits
    that a file keeps, so that a saved and loaded recogniser gives the same numbers.
    """
    from sklearn.utils.extmath import randomized_svd

    vectors = code_vectors(encoder, encodings)
    if encoder.settings.mirror:
        vectors = np.concatenate([vectors, code_vectors(encoder, mirrored_encodings(encodings))])
    count = min(MAX_DIRECTIONS, *vectors.shape)
    _, _, rows = randomized_svd(vectors, count, n_iter=2, random_state=seed)
    directions = np.ascontiguousarray(rows.T).astype(np.float16).astype(np.float32)
    chosen = np.unique(np.linspace(0, len(encodings) - 1, MAX_LANDMARKS).astype(np.int64))
    landmarks = tuple(encodings[int(k)] for k in chosen)
    learned = DistanceFeatures(compare_complexities(encoder, landmarks))
    empty = np.zeros((0, 0), dtype=np.float32)
    unfilled = StoredViews(directions, landmarks, learned, ViewFeatures(empty, empty, empty))
    return StoredViews(directions, landmarks, learned, unfilled.describe(encoder, encodings))
