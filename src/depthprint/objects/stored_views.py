"""What a saved recogniser keeps of the views it learned from, and how it compares others with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.errors import DataError
from depthprint.object_surface import object_surface
from depthprint.objects.distances import (
    MirroredDistances,
    compare_complexities,
    compare_with_batches,
    signature_batches,
    stream_part,
    sum_of_parts,
)
from depthprint.objects.kernels import DistanceFeatures, code_vectors, mirrored_encodings
from depthprint.objects.leading_directions import LeadingDirections
from depthprint.objects.stored_geometry import StoredGeometry
from depthprint.objects.surface_words import SurfaceWords
from depthprint.objects.view_features import ViewFeatures
from depthprint.partial_views import partial_copies
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.signature import SignatureBatch
from depthprint.surflet_pairs import image_pairs, pair_vectors

if TYPE_CHECKING:
    from depthprint._kernels.surface_alignment import SeenSurface

__all__ = [
    "MAX_LANDMARKS",
    "MAX_LANDMARKS_BESIDE_SURFACES",
    "StoredViews",
    "describe_and_store",
    "store_views",
]

Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]
Progress = Callable[[int, int], None]

MAX_LANDMARKS = 48
# Beside surfaces fewer do as well: by nested splits of training objects 51.5 % of 765 views, and 51.6 % with 48.
MAX_LANDMARKS_BESIDE_SURFACES = 24
# Long vectors of so many views, of their copies and mirror images take 1 GB.
DESCRIBED_AT_ONCE = 3000


@dataclass(frozen=True)
class StoredViews:
    """Directions of the pooled codes, landmark encodings with their features, and the views learned from.

    words, surface_directions: the vocabulary of the surface vectors and their directions; pair_directions: those of the
    pairs of points; geometry: the views themselves, for alignment. None where surfaces are not compared.
    """

    directions: LeadingDirections
    landmarks: tuple[Encoding, ...]
    distance_features: DistanceFeatures
    views: ViewFeatures
    words: SurfaceWords | None = None
    surface_directions: LeadingDirections | None = None
    pair_directions: LeadingDirections | None = None
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
        codes = self._codes(encoder, encodings)
        return ViewFeatures(*codes, *self._surfaces(images, encoder.settings.mirror))

    def encode_and_describe(
        self, encoder: Encoder, images: Sequence[RangeImage]
    ) -> tuple[ViewFeatures, list[SeenSurface]]:
        """``describe`` of images that are still to be encoded, and what is seen of each where surfaces are compared.

        Codes and surfaces are made side by side, given two threads. Whichever is done first goes on with what is made
        of the codes, so that both end at nearly one time.
        """
        from depthprint._kernels.tasks import run_tasks

        encoded: Future[list[Encoding]] = Future()
        found: dict[str, list[Float32Array]] = {}
        parts: dict[int, MirroredDistances] = {}
        seen: list[SeenSurface] = []

        def encode() -> None:
            try:
                encoded.set_result([encoder.describe(image) for image in images])
            except BaseException as error:
                encoded.set_exception(error)
                raise

        def surfaces() -> None:
            seen.extend(self._seen(images))
            found["surfaces"] = self._surfaces(images, encoder.settings.mirror)

        def landmarks(number: int) -> None:
            parts[number] = stream_part(encoder, number, encoded.result(), self._landmark_batches[number])

        def sides() -> None:
            found["sides"] = _code_sides(encoder, encoded.result(), self.directions)

        streams = range(len(encoder.settings.streams))
        run_tasks([encode, surfaces, sides, *(partial(landmarks, number) for number in streams)])
        distances = sum_of_parts([parts[number] for number in streams])
        found["landmarks"] = [self.distance_features.of(distances)]
        return ViewFeatures(*found["sides"], *found["landmarks"], *found["surfaces"]), seen

    def _codes(self, encoder: Encoder, encodings: Sequence[Encoding]) -> list[Float32Array]:
        """Codes along their directions, of views and of their mirror images, and features of landmark distances."""
        sides = _code_sides(encoder, encodings, self.directions)
        distances = compare_with_batches(encoder, encodings, self._landmark_batches)
        return [*sides, self.distance_features.of(distances)]

    def _seen(self, images: Sequence[RangeImage]) -> list[SeenSurface]:
        return [] if self.words is None else [object_surface(image) for image in images]

    def _surfaces(self, images: Sequence[RangeImage], mirror: bool) -> list[Float32Array]:
        """Surface vectors along their directions, of views and mirror images, and pairs; none where not compared."""
        if self.words is None or self.surface_directions is None or self.pair_directions is None:
            return []
        # First, so that the views that are coded side by side find them made.
        pairs = np.stack([image_pairs(image) for image in images])
        sides = self.surface_directions.along(self.words.features(images, mirror=mirror))
        return [*sides, *self.pair_directions.along([pairs])]


def describe_and_store(
    encoder: Encoder, images: Sequence[RangeImage], seed: int, progress: Progress | None = None
) -> StoredViews:
    """``store_views`` of images that are still to be encoded, with the shipped words where surfaces are compared.

    Presets that mirror are those of objects; surfaces are known of crops of a pinhole camera alone.
    """
    surfaces = encoder.settings.mirror and isinstance(images[0].projection, Pinhole)
    words = SurfaceWords.load() if surfaces else None
    return store_views(encoder, encoder.describe_many(images, progress), images, seed, words)


def store_views(
    encoder: Encoder,
    encodings: Sequence[Encoding],
    images: Sequence[RangeImage],
    seed: int,
    words: SurfaceWords | None = None,
) -> StoredViews:
    """Learn the leading directions of the views' codes, and choose landmarks evenly among the views.

    Directions are singular vectors of the codes of views and mirror images, and of the surface vectors and the pairs
    of points where ``words`` are given, rounded to the 16 bits that a file keeps, so that a saved and loaded
    recogniser gives the same numbers. Partly hidden copies of the views are described for their surfaces alone.
    """
    most = MAX_LANDMARKS if words is None else MAX_LANDMARKS_BESIDE_SURFACES
    landmarks = tuple(encodings[int(k)] for k in _evenly(len(encodings), most))
    learned = DistanceFeatures(compare_complexities(encoder, landmarks))
    distances = compare_complexities(encoder, encodings, landmarks)

    def codes(numbers: IntArray) -> list[Float32Array]:
        return _code_vectors(encoder, [encodings[k] for k in numbers])

    directions, sides = _along_leading(codes, len(encodings), seed)
    views = ViewFeatures(sides[0], sides[-1], learned.of(distances))
    if words is None:
        return StoredViews(directions, landmarks, learned, views)
    copies = partial_copies(images)

    def surfaces(numbers: IntArray) -> list[Float32Array]:
        some = ([of[k] for k in numbers] for of in (images, copies))
        return [side for of in some for side in words.features(of, mirror=encoder.settings.mirror)]

    def pairs(numbers: IntArray) -> list[Float32Array]:
        return [pair_vectors([of[k] for k in numbers]) for of in (images, copies)]

    surface_directions, of_surfaces = _along_leading(surfaces, len(images), seed)
    pair_directions, of_pairs = _along_leading(pairs, len(images), seed)
    views = replace(
        views,
        surface=of_surfaces[0],
        mirrored_surface=of_surfaces[1],
        partial=of_surfaces[2],
        mirrored_partial=of_surfaces[3],
        pairs=of_pairs[0],
        partial_pairs=of_pairs[1],
    )
    geometry = StoredGeometry.of(images)
    return StoredViews(
        directions, landmarks, learned, views, words, surface_directions, pair_directions, geometry
    )


def _along_leading(
    vectors_of: Callable[[IntArray], list[Float32Array]], n_views: int, seed: int
) -> tuple[LeadingDirections, list[Float32Array]]:
    """Leading directions of up to DESCRIBED_AT_ONCE views, chosen evenly, and all views along them.

    vectors_of: several arrays of vectors of the views of these numbers.
    """
    chosen = _evenly(n_views, DESCRIBED_AT_ONCE)
    vectors = vectors_of(chosen)
    directions = LeadingDirections.of(np.concatenate(vectors), seed)
    if len(chosen) == n_views:
        return directions, directions.along(vectors)
    starts = range(0, n_views, DESCRIBED_AT_ONCE)
    blocks = [np.arange(start, min(start + DESCRIBED_AT_ONCE, n_views)) for start in starts]
    along = [directions.along(vectors_of(block)) for block in blocks]
    return directions, [np.concatenate(parts) for parts in zip(*along, strict=True)]


def _evenly(n: int, most: int) -> IntArray:
    return np.unique(np.linspace(0, n - 1, most).astype(np.int64))


def _code_sides(
    encoder: Encoder, encodings: Sequence[Encoding], directions: LeadingDirections
) -> list[Float32Array]:
    """Codes along the directions, of views and of their mirror images; the first twice where there are none."""
    sides = directions.along(_code_vectors(encoder, encodings))
    return [sides[0], sides[-1]]


def _code_vectors(encoder: Encoder, encodings: Sequence[Encoding]) -> list[Float32Array]:
    """Vectors of codes, and those of the mirror images where the preset mirrors."""
    vectors = [code_vectors(encoder, encodings)]
    if encoder.settings.mirror:
        vectors.append(code_vectors(encoder, mirrored_encodings(encodings)))
    return vectors
