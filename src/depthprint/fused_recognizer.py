"""FusedRecognizer: a cheap vector distance proposes, relaxed bounds thin out, the exact NCD ranks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from depthprint.baselines.cosine import CosineRecognizer
from depthprint.cascade_settings import CascadeSettings
from depthprint.complexity_recognizer import ComplexityRecognizer
from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch

__all__ = ["FusedRecognizer"]


class FusedRecognizer:
    """PlaceRecognizer whose distance is the weighted sum of the NCD and of the cosine distance of the same codes.

    What ``query`` returns has exact distances, but is searched among the proposed places only: unlike
    ComplexityRecognizer it may miss the nearest. Its first k are ranked by the sum; places that were proposed and
    not ranked follow by nothing, so k beyond ``ranked`` returns fewer.
    """

    def __init__(self, encoder: Encoder, settings: CascadeSettings | None = None) -> None:
        self.encoder = encoder
        self.settings = CascadeSettings() if settings is None else settings
        self._vectors = CosineRecognizer(encoder)
        self._index = encoder.make_index()

    def fit(self, images: Sequence[RangeImage]) -> FusedRecognizer:
        """Learn the encoder's dictionaries and forget all places."""
        self._vectors.fit(images)
        self._index = self.encoder.make_index()
        return self

    def describe(self, image: RangeImage) -> Encoding:
        """Encode one frame."""
        return self.encoder.describe(image)

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
        places = np.array([match.place for match in proposed], dtype=np.int64)
        cosines = np.array([match.distance for match in proposed])
        weight = settings.vector_weight
        ranked = max(k, settings.ranked)
        if settings.relaxed and len(places) > ranked:
            bounds = self._index.distances_of(description.signatures, places, relaxed=True)
            kept = np.argsort((1 - weight) * bounds + weight * cosines, kind="stable")[:ranked]
        else:
            kept = np.arange(len(places))
        ncds = self._index.distances_of(description.signatures, places[kept])
        fused = (1 - weight) * ncds + weight * cosines[kept]
        order = np.lexsort((places[kept], fused))[:k]
        return [
            PlaceMatch(int(places[kept[i]]), float(fused[i]), proposed[kept[i]].shift) for i in order
        ]

    def distance(self, first: Encoding, second: Encoding) -> float:
        """Fused distance of two encodings."""
        cosine = self._vectors.distance(first, second)
        if not self.settings.exact:
            return cosine
        weight = self.settings.vector_weight
        return (1 - weight) * ComplexityRecognizer(self.encoder).distance(first, second) + weight * cosine
