"""Our recogniser of places: signatures under the exact, normalised EMD complexity distance."""

from __future__ import annotations

from collections.abc import Sequence

from depthprint.encoded_places import EncodedPlaces
from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch

__all__ = ["ComplexityRecognizer"]


class ComplexityRecognizer(EncodedPlaces):
    """PlaceRecognizer over an Encoder; the k nearest are exact (bounds only order the work).

    ``relaxed`` ranks by the lower bound alone: an ablation.
    """

    def __init__(self, encoder: Encoder, *, relaxed: bool = False) -> None:
        super().__init__(encoder)
        self._relaxed = relaxed
        polar = encoder.settings.streams[0].view == "polar"
        self._sectors = encoder.shift_sectors() if polar else None
        self._index = encoder.make_index()

    def fit(self, images: Sequence[RangeImage]) -> ComplexityRecognizer:
        """Learn the encoder's dictionaries and empty the index."""
        self.encoder.fit(images)
        self._index = self.encoder.make_index()
        return self

    def add(self, description: Encoding) -> int:
        """Store a place."""
        return int(self._index.add(description.signatures))

    def query(self, description: Encoding, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        """Exact k nearest places, smallest normalised information distance first."""
        found = self._index.query(description.signatures, k=k, limit=limit, relaxed=self._relaxed)
        return [
            PlaceMatch(int(place), float(d), None if self._sectors is None else float(self._sectors[shift]))
            for place, d, shift in found
        ]

    def distance(self, first: Encoding, second: Encoding) -> float:
        """Normalised information distance of two encodings."""
        index = self.encoder.make_index()
        index.add(second.signatures)
        return float(index.distances(first.signatures, relaxed=self._relaxed)[0])
