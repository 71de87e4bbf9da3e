"""Stand-ins for methods of place recognition."""

from __future__ import annotations

from depthprint.recognizer import PlaceMatch


class Told:
    """Proposes the place that it is told, whatever it is asked."""

    def __init__(self, place: int = 0):
        self.place, self.stored = place, 0

    def fit(self, images):
        return self

    def describe(self, image):
        return None

    def add(self, description):
        self.stored += 1
        return self.stored - 1

    def query(self, description, k=1, limit=None):
        return [PlaceMatch(self.place, 0.5)]

    def distance(self, first, second):
        return 0.5
