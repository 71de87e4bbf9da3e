"""Stand-ins for methods of place recognition."""

from __future__ import annotations

from depthprint.recognizer import PlaceMatch


class Told:
    """Proposes the place that it is told, at one distance, whatever it is asked."""

    def __init__(self, place: int = 0, distance: float = 0.5):
        self.place, self.apart, self.stored = place, distance, 0

    def fit(self, images):
        return self

    def describe(self, image):
        return None

    def add(self, description):
        self.stored += 1
        return self.stored - 1

    def query(self, description, k=1, limit=None):
        return [PlaceMatch(self.place, self.apart)]

    def distance(self, first, second):
        return self.apart
