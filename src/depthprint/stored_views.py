"""What a saved recogniser keeps of the views it learned from, and how it compares others with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.errors import DataError
from depthprint.object_distances import compare_complexities, compare_with_batches, signature_batches
from depthprint.object_kernels import DistanceFeatures, code_vectors, mirrored_encodings, unit_rows
from depthprint.object_recogniser import KERNEL_SHARES, ViewComparison, fused_comparison
from depthprint.partial_views import partial_copies
from depthprint.range_image import RangeImage
from depthprint.signature import SignatureBatch
from depthprint.stored_geometry import StoredGeometry
from depthprint.surface_words import SurfaceWords

__all__ = [
    "MAX_DIRECTIONS",
    "MAX_LANDMARKS",
    "MAX_LANDMARKS_BESIDE_SURFACES",
    "StoredViews",
    "ViewFeatures",
    "store_views",
]

Float32Array = npt.NDArray[np.float32]

MAX_DIRECTIONS = 384
MAX_LANDMARKS = 48
# Beside surfaces fewer do as well: by nested splits of training objects 51.5 % of 765 views, and 51.6 % with 48.
MAX_LANDMARKS_BESIDE_SURFACES = 24
# So many rows or fewer are multiplied with each row of a matrix read once, and none that only zeros would meet.
FEW_ROWS = 8


@dataclass(frozen=True)
class _Sides:
    """Unit vectors (n, r) of views and of their mirror images."""

    straight: Float32Array
    mirrored: Float32Array

    @cached_property
    def sums(self) -> Float32Array:
        """Unit vectors of the sums of both."""
        return unit_rows(self.straight + self.mirrored)

    @cached_property
    def _columns(self) -> Float32Array:
        """The straight vectors as columns, (r, n)."""
        return np.ascontiguousarray(self.straight.T)

    def kernel_with(self, stored: _Sides) -> Float32Array:
        """Products (m, n) of the sums of views and mirror images."""
        return self.sums @ stored.sums.T

    def distances_to(self, stored: _Sides) -> Float32Array:
        """One minus the cosine of the nearer (m, n), of a view or of its mirror image."""
        if 2 * len(self.straight) <= FEW_ROWS:
            both = _products(np.concatenate([self.straight, self.mirrored]), stored._columns)
            cosine = np.maximum(*np.split(both, 2))
        else:
            cosine = np.maximum(self.straight @ stored.straight.T, self.mirrored @ stored.straight.T)
        if self is stored:
            cosine = np.maximum(cosine, cosine.T)
        return np.maximum(1.0 - cosine, 0.0)


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

    @cached_property
    def _codes(self) -> _Sides:
        return _Sides(self.straight, self.mirrored)

    @cached_property
    def _surface_sides(self) -> _Sides | None:
        if self.surface is None or self.mirrored_surface is None:
            return None
        return _Sides(self.surface, self.mirrored_surface)

    @cached_property
    def _with_copies(self) -> _Sides | None:
        """Surface vectors of the views, then of their partial copies, and those of their mirror images."""
        if self.partial is None or self.mirrored_partial is None or self._surface_sides is None:
            return self._surface_sides
        views = self._surface_sides
        return _Sides(
            np.concatenate([views.straight, self.partial]),
            np.concatenate([views.mirrored, self.mirrored_partial]),
        )

    @cached_property
    def _known(self) -> Float32Array:
        """Surface vectors of the views, then of their mirror images: what the machine learns from."""
        return np.concatenate([rows for rows in (self.surface, self.mirrored_surface) if rows is not None])

    def taken(self, rows: npt.NDArray[np.integer]) -> ViewFeatures:
        """Some of the views."""
        surfaces = (None if array is None else array[rows] for array in self._surfaces())
        return ViewFeatures(self.straight[rows], self.mirrored[rows], self.landmark[rows], *surfaces)

    @property
    def code_sums(self) -> Float32Array:
        """Unit vectors (n, r) of the sums of the codes of views and of their mirror images."""
        return self._codes.sums

    @property
    def surface_sums(self) -> Float32Array | None:
        """Those of the surface vectors, followed by those of partial copies where these are learned from."""
        return None if self._with_copies is None else self._with_copies.sums

    @property
    def known_surfaces(self) -> Float32Array | None:
        """Surface vectors of the views, then of their mirror images: what the machine learns from."""
        return None if self.surface is None else self._known

    def compared_with(self, stored: ViewFeatures) -> ViewComparison:
        """Kernel values and distances (m, n) to other views."""
        near = self.distances_to(stored)
        parts = [
            ViewComparison(self._codes.kernel_with(stored._codes), near[:1]),
            ViewComparison(self.landmark @ stored.landmark.T),
        ]
        shares = [KERNEL_SHARES["codes"], KERNEL_SHARES["complexities"]]
        sides, others = self._sides_against(stored)
        if sides is not None and others is not None and self.surface is not None:
            machine = (stored._known if self is stored else self.surface) @ stored._known.T
            parts.append(ViewComparison(sides.kernel_with(others), near[1:], machine))
            shares.append(KERNEL_SHARES["surfaces"])
        return fused_comparison(parts, shares)

    def distances_to(self, stored: ViewFeatures) -> tuple[Float32Array, ...]:
        """Distances (m, n) to other views by their codes, and (m, k n) by surfaces where these are compared."""
        near = self._codes.distances_to(stored._codes)
        sides, others = self._sides_against(stored)
        return (near,) if sides is None or others is None else (near, sides.distances_to(others))

    def _sides_against(self, stored: ViewFeatures) -> tuple[_Sides | None, _Sides | None]:
        """Surfaces to compare: among themselves views have all copies; others ask for none of theirs."""
        sides = self._with_copies if self is stored else self._surface_sides
        if sides is not None and stored._with_copies is None:
            raise DataError("views: expected stored views with surface vectors, got some without")
        return sides, stored._with_copies


@dataclass(frozen=True)
class StoredViews:
    """Directions of the pooled codes (d, r), landmark encodings with their features, and the views learned from.

    words, surface_directions: the vocabulary of the surface vectors and their directions; geometry: the views
    themselves, for alignment. None where surfaces are not compared.
    """

    directions: Float32Array
    landmarks: tuple[Encoding, ...]
    distance_features: DistanceFeatures
    views: ViewFeatures
    words: SurfaceWords | None = None
    surface_directions: Float32Array | None = None
    geometry: StoredGeometry | None = None

    def __post_init__(self) -> None:
        if self.geometry is not None and len(self.geometry) != len(self.views):
            raise DataError(
                f"stored views: expected the geometry of {len(self.views)} views, got {len(self.geometry)}"
            )

    @cached_property
    def _landmark_batches(self) -> list[SignatureBatch]:
        return signature_batches(self.landmarks)

    def describe(
        self, encoder: Encoder, encodings: Sequence[Encoding], images: Sequence[RangeImage]
    ) -> ViewFeatures:
        """Bring images, encoded by the same encoder, into the form of the stored views."""
        surfaces: tuple[Float32Array, ...] = ()
        if self.words is not None:
            surfaces = self.words.features(images, mirror=encoder.settings.mirror)
        return self._joined(encoder, encodings, surfaces)

    def encode_and_describe(self, encoder: Encoder, images: Sequence[RangeImage]) -> ViewFeatures:
        """``describe`` of images that are still to be encoded, which goes on beside it where there are two threads."""
        from depthprint._kernels.blocks import for_blocks

        words, mirror = self.words, encoder.settings.mirror
        groups = [] if words is None else words.groups
        encodings: dict[int, Encoding] = {}
        parts: dict[tuple[int, int], list[Float32Array]] = {}

        def work(number: int, _: int) -> None:
            # Encodings take longest, so they come first.
            group, image = divmod(number, len(images))
            if group == 0:
                encodings[image] = encoder.describe(images[image])
            elif words is not None:
                parts[image, group - 1] = words.part(images[image], groups[group - 1], mirror)

        for_blocks(len(images) * (1 + len(groups)), 1, work)
        surfaces: tuple[Float32Array, ...] = ()
        if words is not None:
            of_images = [
                words.joined([parts[image, group] for group in range(len(groups))])
                for image in range(len(images))
            ]
            sides = np.stack(of_images, axis=1)
            surfaces = sides[0], sides[-1]
        return self._joined(encoder, [encodings[image] for image in range(len(images))], surfaces)

    def _joined(
        self, encoder: Encoder, encodings: Sequence[Encoding], surfaces: Sequence[Float32Array]
    ) -> ViewFeatures:
        from depthprint._kernels.blocks import for_blocks

        known = self.surface_directions
        codes: list[Float32Array] = []
        along: list[Float32Array | None] = [None, None]

        def work(number: int, _: int) -> None:
            if number == 0:
                codes[:] = _code_sides(encoder, encodings, self.directions)
            elif known is not None:
                along[:] = _along(known, surfaces)

        for_blocks(1 + (known is not None and len(surfaces) > 0), 1, work)
        distances = compare_with_batches(encoder, encodings, self._landmark_batches)
        return ViewFeatures(codes[0], codes[1], self.distance_features.of(distances), along[0], along[1])


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
    most = MAX_LANDMARKS if words is None else MAX_LANDMARKS_BESIDE_SURFACES
    chosen = np.unique(np.linspace(0, len(encodings) - 1, most).astype(np.int64))
    landmarks = tuple(encodings[int(k)] for k in chosen)
    learned = DistanceFeatures(compare_complexities(encoder, landmarks))
    distances = compare_complexities(encoder, encodings, landmarks)
    straight, mirrored = _code_sides(encoder, encodings, directions)
    views = ViewFeatures(straight, mirrored, learned.of(distances))
    if words is None:
        return StoredViews(directions, landmarks, learned, views)
    mirror = encoder.settings.mirror
    whole = words.features(images, mirror=mirror)
    copies = words.features(partial_copies(images), mirror=mirror)
    surface_directions = _leading_directions(np.concatenate([*whole, *copies]), seed)
    surfaces = [*_along(surface_directions, whole), *_along(surface_directions, copies)]
    views = ViewFeatures(views.straight, views.mirrored, views.landmark, *surfaces)
    geometry = StoredGeometry.of(images)
    return StoredViews(directions, landmarks, learned, views, words, surface_directions, geometry)


def _code_sides(
    encoder: Encoder, encodings: Sequence[Encoding], directions: Float32Array
) -> list[Float32Array]:
    """Codes along the directions, of views and of their mirror images; the first twice where there are none."""
    vectors = [code_vectors(encoder, encodings)]
    if encoder.settings.mirror:
        vectors.append(code_vectors(encoder, mirrored_encodings(encodings)))
    sides = _along(directions, vectors)
    return [sides[0], sides[-1]]


def _along(directions: Float32Array, vectors: Sequence[Float32Array]) -> list[Float32Array]:
    """Unit vectors along the directions, of views and of their mirror images."""
    rows = np.concatenate(vectors)
    products = _products(rows, directions) if len(rows) <= FEW_ROWS else rows @ directions
    return np.split(unit_rows(products), len(vectors))


def _products(rows: Float32Array, matrix: Float32Array) -> Float32Array:
    from depthprint._kernels.sparse_rows import sparse_products

    return np.asarray(sparse_products(rows, matrix))


def _leading_directions(vectors: Float32Array, seed: int) -> Float32Array:
    from sklearn.utils.extmath import randomized_svd

    count = min(MAX_DIRECTIONS, *vectors.shape)
    _, _, rows = randomized_svd(vectors, count, n_iter=2, random_state=seed)
    return np.ascontiguousarray(rows.T).astype(np.float16).astype(np.float32)
