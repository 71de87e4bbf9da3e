"""What a saved recogniser keeps of the views it learned from, and how it compares others with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.object_distances import compare_complexities
from depthprint.object_kernels import DistanceFeatures, code_vectors, mirrored_encodings, unit_rows
from depthprint.object_recogniser import ViewComparison
from depthprint.range_image import RangeImage
from depthprint.surface_words import SurfaceWords

__all__ = ["MAX_DIRECTIONS", "MAX_LANDMARKS", "StoredViews", "ViewFeatures", "store_views"]

Float32Array = npt.NDArray[np.float32]

MAX_DIRECTIONS = 384
MAX_LANDMARKS = 48


@dataclass(frozen=True)
class ViewFeatures:
    """Views as short vectors, (n, r) each, read-only.

    straight, mirrored: unit pooled codes along the leading directions; ``mirrored`` equals ``straight`` where the
    preset does not mirror. landmark: unit features of the information distance to the landmarks. surface: unit
    surface vectors along theirs, or None where surfaces are not compared.
    """

    straight: Float32Array
    mirrored: Float32Array
    landmark: Float32Array
    surface: Float32Array | None = None

    def __post_init__(self) -> None:
        for array in (self.straight, self.mirrored, self.landmark, self.surface):
            if array is not None:
                array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.straight)

    def taken(self, rows: npt.NDArray[np.integer]) -> ViewFeatures:
        """Some of the views."""
        surface = None if self.surface is None else self.surface[rows]
        return ViewFeatures(self.straight[rows], self.mirrored[rows], self.landmark[rows], surface)

    def compared_with(self, stored: ViewFeatures) -> ViewComparison:
        """Kernel values and distances (m, n) to other views."""
        kernel = unit_rows(self.straight + self.mirrored) @ unit_rows(stored.straight + stored.mirrored).T
        cosine = np.maximum(self.straight @ stored.straight.T, self.mirrored @ stored.straight.T)
        if self is stored:
            cosine = np.maximum(cosine, cosine.T)
        kernel += self.landmark @ stored.landmark.T
        nearest = np.maximum(1.0 - cosine, 0.0)
        if self.surface is None or stored.surface is None:
            return ViewComparison(kernel / 2, (nearest,))
        surfaces = self.surface @ stored.surface.T
        return ViewComparison((kernel + surfaces) / 3, (nearest, np.maximum(1.0 - surfaces, 0.0)))


@dataclass(frozen=True)
class StoredViews:
    """Directions of the pooled codes (d, r), landmark encodings with their features, and the views learned from.

    words, surface_directions: the vocabulary of the surface vectors and their directions; None where surfaces are not
    compared.
    """

    directions: Float32Array
    landmarks: tuple[Encoding, ...]
    distance_features: DistanceFeatures
    views: ViewFeatures
    words: SurfaceWords | None = None
    surface_directions: Float32Array | None = None

    def describe(
        self, encoder: Encoder, encodings: Sequence[Encoding], images: Sequence[RangeImage]
    ) -> ViewFeatures:
        """Bring images, encoded by the same encoder, into the form of the stored views."""
        surface = None
        if self.words is not None and self.surface_directions is not None:
            surface = unit_rows(surface_vectors(self.words, encoder, images) @ self.surface_directions)
        straight = unit_rows(code_vectors(encoder, encodings) @ self.directions)
        mirrored = straight
        if encoder.settings.mirror:
            mirrored = unit_rows(code_vectors(encoder, mirrored_encodings(encodings)) @ self.directions)
        distances = compare_complexities(encoder, encodings, self.landmarks)
        return ViewFeatures(straight, mirrored, self.distance_features.of(distances), surface)


def surface_vectors(words: SurfaceWords, encoder: Encoder, images: Sequence[RangeImage]) -> Float32Array:
    """Surface vectors (n, d) of images, mirrored where the encoder mirrors."""
    return words.features(images, mirror=encoder.settings.mirror)


def store_views(
    encoder: Encoder,
    encodings: Sequence[Encoding],
    images: Sequence[RangeImage],
    seed: int,
    words: SurfaceWords | None = None,
) -> StoredViews:
    """Learn the leading directions of the views' codes, and choose landmarks evenly among the views.

    Directions are singular vectors of the codes of views and mirror images, and of the surface vectors where
    ``words`` are given (randomised, seeded), rounded to the 16 bits that a file keeps, so that a saved and loaded
    recogniser gives the same numbers.
    """
    vectors = code_vectors(encoder, encodings)
    if encoder.settings.mirror:
        vectors = np.concatenate([vectors, code_vectors(encoder, mirrored_encodings(encodings))])
    directions = _leading_directions(vectors, seed)
    chosen = np.unique(np.linspace(0, len(encodings) - 1, MAX_LANDMARKS).astype(np.int64))
    landmarks = tuple(encodings[int(k)] for k in chosen)
    learned = DistanceFeatures(compare_complexities(encoder, landmarks))
    empty = np.zeros((0, 0), dtype=np.float32)
    surface_directions = None
    if words is not None:
        surface_directions = _leading_directions(surface_vectors(words, encoder, images), seed)
    unfilled = StoredViews(
        directions, landmarks, learned, ViewFeatures(empty, empty, empty), words, surface_directions
    )
    return replace(unfilled, views=unfilled.describe(encoder, encodings, images))


def _leading_directions(vectors: Float32Array, seed: int) -> Float32Array:
    from sklearn.utils.extmath import randomized_svd

    count = min(MAX_DIRECTIONS, *vectors.shape)
    _, _, rows = randomized_svd(vectors, count, n_iter=2, random_state=seed)
    return np.ascontiguousarray(rows.T).astype(np.float16).astype(np.float32)
