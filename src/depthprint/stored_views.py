"""What a saved recogniser keeps of the views it learned from, and how it compares others with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.errors import DataError
from depthprint.object_distances import compare_complexities
from depthprint.object_kernels import DistanceFeatures, code_vectors, mirrored_encodings, unit_rows
from depthprint.object_recogniser import KERNEL_SHARES, ViewComparison, fused_comparison
from depthprint.partial_views import partial_copies
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
    preset does not mirror. landmark: unit features of the information distance to the landmarks. surface,
    mirrored_surface: unit surface vectors along theirs, or None where surfaces are not compared. partial,
    mirrored_partial: those of partly hidden copies of the views, where these are learned from.
    """

    straight: Float32Array
    mirrored: Float32Array
    landmark: Float32Array
    surface: Float32Array | None = None
    mirrored_surface: Float32Array | None = None
    partial: Float32Array | None = None
    mirrored_partial: Float32Array | None = None

    def __post_init__(self) -> None:
        for array in (self.straight, self.mirrored, self.landmark, *self._surfaces()):
            if array is not None:
                array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.straight)

    def _surfaces(self) -> tuple[Float32Array | None, ...]:
        return self.surface, self.mirrored_surface, self.partial, self.mirrored_partial

    def _with_copies(self) -> tuple[Float32Array, Float32Array]:
        """Surface vectors of the views, then of their partial copies, and those of their mirror images."""
        straight, mirrored = (
            np.concatenate([rows for rows in pair if rows is not None])
            for pair in ((self.surface, self.partial), (self.mirrored_surface, self.mirrored_partial))
        )
        return straight, mirrored

    def taken(self, rows: npt.NDArray[np.integer]) -> ViewFeatures:
        """Some of the views."""
        surfaces = (None if array is None else array[rows] for array in self._surfaces())
        return ViewFeatures(self.straight[rows], self.mirrored[rows], self.landmark[rows], *surfaces)

    def compared_with(self, stored: ViewFeatures) -> ViewComparison:
        """Kernel values and distances (m, n) to other views."""
        kernel, nearest = _mirrored_kernel(self.straight, self.mirrored, stored.straight, stored.mirrored)
        parts = [ViewComparison(kernel, (nearest,)), ViewComparison(self.landmark @ stored.landmark.T)]
        shares = [KERNEL_SHARES["codes"], KERNEL_SHARES["complexities"]]
        if self.surface is not None and self.mirrored_surface is not None:
            if stored.surface is None or stored.mirrored_surface is None:
                raise DataError("views: expected stored views with surface vectors, got some without")
            known = np.concatenate([stored.surface, stored.mirrored_surface])
            machine = (known if self is stored else self.surface) @ known.T
            views = self._with_copies() if self is stored else (self.surface, self.mirrored_surface)
            kernel, nearest = _mirrored_kernel(*views, *(views if self is stored else stored._with_copies()))
            parts.append(ViewComparison(kernel, (nearest,), machine))
            shares.append(KERNEL_SHARES["surfaces"])
        return fused_comparison(parts, shares)


def _mirrored_kernel(
    straight: Float32Array, mirrored: Float32Array, stored: Float32Array, stored_mirrored: Float32Array
) -> tuple[Float32Array, Float32Array]:
    """Kernel of the sums of views and mirror images, and one minus the cosine of the nearer."""
    kernel = unit_rows(straight + mirrored) @ unit_rows(stored + stored_mirrored).T
    cosine = np.maximum(straight @ stored.T, mirrored @ stored.T)
    if straight is stored:
        cosine = np.maximum(cosine, cosine.T)
    return kernel, np.maximum(1.0 - cosine, 0.0)


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
        surfaces: Sequence[Float32Array] = ()
        if self.words is not None and self.surface_directions is not None:
            surfaces = _along(
                self.surface_directions, self.words.features(images, mirror=encoder.settings.mirror)
            )
        codes = _code_features(encoder, encodings, self.directions, self.landmarks, self.distance_features)
        return ViewFeatures(codes.straight, codes.mirrored, codes.landmark, *surfaces)


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
    recogniser gives the same numbers. Partly hidden copies of the views are described for their surfaces alone.
    """
    vectors = code_vectors(encoder, encodings)
    if encoder.settings.mirror:
        vectors = np.concatenate([vectors, code_vectors(encoder, mirrored_encodings(encodings))])
    directions = _leading_directions(vectors, seed)
    chosen = np.unique(np.linspace(0, len(encodings) - 1, MAX_LANDMARKS).astype(np.int64))
    landmarks = tuple(encodings[int(k)] for k in chosen)
    learned = DistanceFeatures(compare_complexities(encoder, landmarks))
    views = _code_features(encoder, encodings, directions, landmarks, learned)
    if words is None:
        return StoredViews(directions, landmarks, learned, views)
    mirror = encoder.settings.mirror
    whole = words.features(images, mirror=mirror)
    copies = words.features(partial_copies(images), mirror=mirror)
    surface_directions = _leading_directions(np.concatenate([*whole, *copies]), seed)
    surfaces = _along(surface_directions, [*whole, *copies])
    views = ViewFeatures(views.straight, views.mirrored, views.landmark, *surfaces)
    return StoredViews(directions, landmarks, learned, views, words, surface_directions)


def _code_features(
    encoder: Encoder,
    encodings: Sequence[Encoding],
    directions: Float32Array,
    landmarks: Sequence[Encoding],
    distance_features: DistanceFeatures,
) -> ViewFeatures:
    straight = unit_rows(code_vectors(encoder, encodings) @ directions)
    mirrored = straight
    if encoder.settings.mirror:
        mirrored = unit_rows(code_vectors(encoder, mirrored_encodings(encodings)) @ directions)
    distances = compare_complexities(encoder, encodings, landmarks)
    return ViewFeatures(straight, mirrored, distance_features.of(distances))


def _along(directions: Float32Array, vectors: Sequence[Float32Array]) -> list[Float32Array]:
    return [unit_rows(rows @ directions) for rows in vectors]


def _leading_directions(vectors: Float32Array, seed: int) -> Float32Array:
    from sklearn.utils.extmath import randomized_svd

    count = min(MAX_DIRECTIONS, *vectors.shape)
    _, _, rows = randomized_svd(vectors, count, n_iter=2, random_state=seed)
    return np.ascontiguousarray(rows.T).astype(np.float16).astype(np.float32)
