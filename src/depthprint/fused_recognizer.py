"""FusedRecognizer: a cheap vector distance proposes, relaxed bounds thin out, the exact NCD ranks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from depthprint.baselines.cosine import CosineRecognizer
from depthprint.cascade_settings import CascadeSettings
from depthprint.complexity_recognizer import ComplexityRecognizer
from depthprint.encoded_places import EncodedPlaces
from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.proposals import spread_in_time
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch

__all__ = ["FusedRecognizer"]


class FusedRecognizer(EncodedPlaces):
    """PlaceRecognizer whose distance is the weighted sum of the NCD and of the cosine distance of the same codes.

    What ``query`` returns has exact distances, but is searched among the proposed places only: unlike
    ComplexityRecognizer it may miss the nearest. Where ``settings`` say that geometry comes after, its proposals
    are spread out in time.
    """

    def __init__(self, encoder: Encoder, settings: CascadeSettings | None = None) -> None:
        super().__init__(encoder)
        self.settings = CascadeSettings() if settings is None else settings
        self._vectors = CosineRecognizer(encoder)
        self._index = encoder.make_index()

    def fit(self, images: Sequence[RangeImage]) -> FusedRecognizer:
        """Learn the encoder's dictionaries and forget all places."""
        self._vectors.fit(images)
        self._index = self.encoder.make_index()
        return self

    def add(self, description: Encoding) -> int:
        """Store a place."""
        self._vectors.add(description)
        return int(self._index.add(description.signatures))

    def query(self, description: Encoding, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        """Best places by the fused distance, with the shift in sectors of a bird's-eye view."""
        settings = self.settings
        proposed = self._vectors.query(description, max(k, settings.proposed), limit)
        if not settings.exact or not proposed:
            return proposed[:k]
        from depthprint._kernels.threads import one_thread

        # Distances to a few places take less than waking another thread.
        with one_thread():
            return self._ranked(description, proposed, k)

    def _ranked(self, description: Encoding, proposed: list[PlaceMatch], k: int) -> list[PlaceMatch]:
        """The most promising proposals by their exact, fused distances."""
        settings = self.settings
        weight = settings.vector_weight
        ranked = self._thinned(description, proposed, max(k, settings.ranked))
        places = np.array([match.place for match in ranked], dtype=np.int64)
        ncds = self._index.distances_of(description.signatures, places)
        fused = [
            replace(match, distance=(1 - weight) * float(ncd) + weight * match.distance)
            for match, ncd in zip(ranked, ncds, strict=True)
        ]
        return sorted(fused, key=lambda match: (match.distance, match.place))[:k]

    def turned(self, description: Encoding, k: int, limit: int | None = None) -> list[PlaceMatch]:
        """Best places by the vectors alone at shifts over those of the encoder, up to half a bird's-eye view.

        They find places entered from a bend. ``shift`` is a share of the view's width here. None where the view is no
        bird's-eye one or a full circle.
        """
        reach = self.encoder.settings.max_shift
        polar = self.encoder.settings.polar
        if polar.full_circle or not any(s.view == "polar" for s in self.encoder.settings.streams):
            return []
        further = range(reach + 1, polar.sectors // 2 + 1, 2)
        sectors = [sign * sector for sector in further for sign in (-1, 1)]
        spread = self.settings.spread
        proposed = self._vectors.query(description, k * 2 * spread, limit, sectors)
        return [
            replace(match, shift=(match.shift or 0.0) / polar.sectors)
            for match in spread_in_time(proposed, k, spread)
        ]

    def _thinned(self, description: Encoding, proposed: list[PlaceMatch], count: int) -> list[PlaceMatch]:
        """The most promising proposals, by their relaxed bounds; spread out where geometry comes after."""
        settings = self.settings
        if settings.relaxed and len(proposed) > count:
            places = np.array([match.place for match in proposed], dtype=np.int64)
            bounds = self._index.distances_of(description.signatures, places, relaxed=True)
            weight = settings.vector_weight
            promise = (1 - weight) * bounds + weight * np.array([match.distance for match in proposed])
            proposed = [proposed[i] for i in np.argsort(promise, kind="stable")]
        return spread_in_time(proposed, count, settings.spread if settings.verify else 1)

    def distance(self, first: Encoding, second: Encoding) -> float:
        """Fused distance of two encodings."""
        cosine = self._vectors.distance(first, second)
        if not self.settings.exact:
            return cosine
        weight = self.settings.vector_weight
        return (1 - weight) * ComplexityRecognizer(self.encoder).distance(first, second) + weight * cosine
