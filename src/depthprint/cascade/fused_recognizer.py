"""FusedRecognizer: cheap distances propose, relaxed bounds thin out, the exact NCD ranks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.baselines.cosine import CosineRecognizer
from depthprint.baselines.scan_context_like import ScanContextLikeRecognizer
from depthprint.cascade.proposals import spread_in_time, taken_in_turn
from depthprint.cascade.range_thumbnail import RangeThumbnails, range_thumbnail
from depthprint.cascade.settings import CascadeSettings
from depthprint.complexity_recognizer import ComplexityRecognizer
from depthprint.encoded_places import EncodedPlaces
from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.errors import DataError
from depthprint.presets import bird_eye_columns, is_planar
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch

__all__ = ["FusedEncoding", "FusedRecognizer"]

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True)
class FusedEncoding(Encoding):
    """An encoding, and what else the fused distance or its proposals compare.

    thumbnail: as `range_thumbnail` makes it. columns: (sectors, rings) of an uncoded bird's-eye map. None where the
    settings have no use for it.
    """

    thumbnail: Float32Array | None = None
    columns: Float32Array | None = None


class FusedRecognizer(EncodedPlaces):
    """PlaceRecognizer whose distance is the weighted sum of the NCD, the cosine of the same codes, and thumbnails.

    What ``query`` returns has exact distances, but is searched among the proposed places only: unlike
    ComplexityRecognizer it may miss the nearest. Where ``settings`` say that geometry comes after, its proposals
    are spread out in time, and every other one is the best left by the columns of the uncoded map.
    """

    def __init__(self, encoder: Encoder, settings: CascadeSettings | None = None) -> None:
        super().__init__(encoder)
        self.settings = CascadeSettings() if settings is None else settings
        self._polar = any(stream.view == "polar" for stream in encoder.settings.streams)
        self._thumbnail_weight = self.settings.weight_of_thumbnails(perspective=not self._polar)
        self._vectors = CosineRecognizer(encoder)
        self._forget()

    def fit(self, images: Sequence[RangeImage]) -> FusedRecognizer:
        """Learn the encoder's dictionaries and forget all places."""
        self._vectors.fit(images)
        self._forget()
        return self

    def describe(self, image: RangeImage) -> FusedEncoding:
        """Encode one frame, with its thumbnail and its map where they are compared."""
        encoding = self.encoder.describe(image)
        return FusedEncoding(
            encoding.signatures,
            encoding.vectors,
            encoding.mirrored,
            None if self._thumbnails is None else range_thumbnail(image),
            None if self._columns is None else self._columns.describe(image),
        )

    def add(self, description: Encoding) -> int:
        """Store a place; DataError where it lacks what the settings compare."""
        thumbnail, columns = self._thumbnail(description), self._map_columns(description)
        self._vectors.add(description)
        if self._thumbnails is not None:
            self._thumbnails.add(thumbnail)
        if self._columns is not None:
            self._columns.add(columns)
        return int(self._index.add(description.signatures))

    def query(self, description: Encoding, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        """Best places by the fused distance, with the shift in sectors of a bird's-eye view."""
        shifted = self._vectors.distances(description, limit)
        if not shifted.size:
            return []
        vectors = shifted.min(0)
        thumbnails = None
        if self._thumbnails is not None:
            thumbnails = self._thumbnails.distances(self._thumbnail(description), limit)
        cheap = self._joined(vectors, thumbnails)
        from depthprint._kernels.threads import one_thread

        # Distances to a few places take less than waking another thread.
        with one_thread():
            places = self._proposed(description, vectors, thumbnails, cheap, k)
            distances = cheap[places]
            if self.settings.exact:
                ncds = self._index.distances_of(description.signatures, places)
                seen = None if thumbnails is None else thumbnails[places]
                distances = self._joined(self._coded(ncds, vectors[places]), seen)
        shifts = np.asarray(self.encoder.shift_sectors(), dtype=np.float64)[shifted[:, places].argmin(0)]
        matches = [
            PlaceMatch(place, distance, shift)
            for place, distance, shift in zip(
                places.tolist(), distances.tolist(), shifts.tolist(), strict=True
            )
        ]
        return sorted(matches, key=lambda match: (match.distance, match.place))[:k]

    def turned(self, description: Encoding, k: int, limit: int | None = None) -> list[PlaceMatch]:
        """Best places by the vectors alone at shifts over those of the encoder, up to half a bird's-eye view.

        They find places entered from a bend. ``shift`` is a share of the view's width here. None where the view is no
        bird's-eye one or a full circle.
        """
        reach = self.encoder.settings.max_shift
        polar = self.encoder.settings.polar
        if polar.full_circle or not self._polar:
            return []
        further = range(reach + 1, polar.sectors // 2 + 1, 2)
        sectors = [sign * sector for sector in further for sign in (-1, 1)]
        spread = self.settings.spread
        proposed = self._vectors.query(description, k * 2 * spread, limit, sectors)
        return [
            replace(match, shift=(match.shift or 0.0) / polar.sectors)
            for match in spread_in_time(proposed, k, spread)
        ]

    def distance(self, first: Encoding, second: Encoding) -> float:
        """Fused distance of two encodings."""
        coded = np.array([self._vectors.distance(first, second)])
        if self.settings.exact:
            ncd = ComplexityRecognizer(self.encoder).distance(first, second)
            coded = self._coded(np.array([ncd]), coded)
        seen = None
        if self._thumbnails is not None:
            pair = RangeThumbnails(wraps=self._wraps)
            pair.add(self._thumbnail(second))
            seen = pair.distances(self._thumbnail(first))
        return float(self._joined(coded, seen)[0])

    def pack(self, description: Encoding) -> dict[str, npt.NDArray[Any]]:
        """Arrays of an encoding, ``thumbnail`` and ``columns``, for a place database."""
        arrays = super().pack(description)
        if self._thumbnails is not None:
            arrays["thumbnail"] = self._thumbnail(description)
        if self._columns is not None:
            arrays["columns"] = self._map_columns(description)
        return arrays

    def unpack(self, arrays: Mapping[str, npt.NDArray[Any]]) -> FusedEncoding:
        """The encoding that ``pack`` took apart; DataError where it lacks what the settings compare."""
        encoding = super().unpack(arrays)
        for name, wanted in (("thumbnail", self._thumbnails), ("columns", self._columns)):
            if wanted is not None and name not in arrays:
                raise DataError(
                    f"place: expected an array {name!r}, got {', '.join(sorted(arrays))}; "
                    "maps of older versions open with CascadeSettings(thumbnail_weight=0, columns=False)"
                )
        return FusedEncoding(
            encoding.signatures,
            encoding.vectors,
            encoding.mirrored,
            arrays.get("thumbnail"),
            arrays.get("columns"),
        )

    def _forget(self) -> None:
        settings = self.encoder.settings
        self._index = self.encoder.make_index()
        self._wraps = settings.polar.full_circle and self._polar
        self._thumbnails = RangeThumbnails(wraps=self._wraps) if self._thumbnail_weight > 0 else None
        self._columns: ScanContextLikeRecognizer | None = None
        wanted = self.settings.columns
        if wanted is None:
            wanted = not self._polar or is_planar(settings)
        if wanted and self.settings.verify and not self._wraps:
            polar, channels, max_shift = bird_eye_columns(settings)
            self._columns = ScanContextLikeRecognizer(polar, channels[:1], max_shift)

    def _proposed(
        self,
        description: Encoding,
        vectors: npt.NDArray[np.floating],
        thumbnails: npt.NDArray[np.floating] | None,
        cheap: npt.NDArray[np.floating],
        k: int,
    ) -> npt.NDArray[np.int64]:
        """Places to rank: the most promising by cheap distances and relaxed bounds, spread where geometry follows."""
        settings = self.settings
        count = max(k, settings.ranked) if settings.exact else k
        order = np.argsort(cheap, kind="stable")
        promising = order[: max(k, settings.proposed)]
        if settings.exact and settings.relaxed and len(promising) > count:
            bounds = self._index.distances_of(description.signatures, promising, relaxed=True)
            seen = None if thumbnails is None else thumbnails[promising]
            promise = self._joined(self._coded(bounds, vectors[promising]), seen)
            order[: len(promising)] = promising[np.argsort(promise, kind="stable")]
        if not settings.verify:
            return order[:count]
        rankings = [order]
        if self._columns is not None:
            maps = self._columns.distances(self._map_columns(description), len(cheap)).min(0)
            rankings.append(np.argsort(maps, kind="stable"))
        return taken_in_turn(rankings, len(cheap), count, settings.spread)

    def _coded(
        self, ncds: npt.NDArray[np.floating], vectors: npt.NDArray[np.floating]
    ) -> npt.NDArray[np.float64]:
        weight = self.settings.vector_weight
        return np.asarray((1 - weight) * ncds + weight * vectors, dtype=np.float64)

    def _joined(
        self, coded: npt.NDArray[np.floating], thumbnails: npt.NDArray[np.floating] | None
    ) -> npt.NDArray[np.floating]:
        if thumbnails is None:
            return coded
        weight = self._thumbnail_weight
        return np.asarray((1 - weight) * coded + weight * thumbnails)

    def _thumbnail(self, description: Encoding) -> Float32Array:
        return _part(description, "thumbnail", self._thumbnails is not None)

    def _map_columns(self, description: Encoding) -> Float32Array:
        return _part(description, "columns", self._columns is not None)


def _part(description: Encoding, name: str, wanted: bool) -> Float32Array:
    """A further part of a description; DataError where it is wanted and missing."""
    part: Float32Array | None = getattr(description, name, None)
    if part is None and wanted:
        raise DataError(
            f"fused distance: expected a description with {name}, as describe() of these settings makes it"
        )
    return np.empty((0, 0), dtype=np.float32) if part is None else part
