"""CheckedPlaces: what the geometric check said of the places that one query was compared with."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from depthprint.recognizer import PlaceMatch
from depthprint.verification.hypotheses import Hypothesis, OtherFrames
from depthprint.verification.verifier import Verification

__all__ = ["CheckedPlaces", "distance_of", "evidence_of"]

FloatArray = npt.NDArray[np.float64]

# With this much nearness nothing better is looked for.
_CERTAIN = 0.6
# Accepted places that are at most so many frames apart are one place, seen from nearer and further.
_ONE_PLACE = 10


class CheckedPlaces:
    """Places that one query was checked against, and what that says.

    one_spot: whether two places, with the poses of the query in them, mean one spot; None for where it cannot be told.
    slips: places next to each other may well not, as planar scans along a corridor.
    """

    def __init__(
        self,
        pool: Sequence[PlaceMatch],
        spread: int,
        one_spot: Callable[[int, FloatArray, int, FloatArray], bool | None] | None = None,
        slips: bool = False,
    ) -> None:
        self.found: dict[int, Verification] = {}
        self._others: dict[int, OtherFrames] = {}
        self._plausible: set[int] = set()
        self._pool = {match.place: match for match in pool}
        self._spread = spread
        self._one_spot, self._slips = one_spot, slips

    def accepted(self, place: int) -> bool:
        """Whether a place was checked and passed."""
        found = self.found.get(place)
        return found is not None and found.accepted

    def add(self, place: int, found: Verification, others: OtherFrames, plausible: bool) -> None:
        """Take in a check; ``others``: what other frames say; ``plausible``: it would do for a seconded place.

        Of two checks of one place that which agrees more counts, an accepted one first.
        """
        before = self.found.get(place)
        if before is not None and _rank(before) >= _rank(found):
            return
        self.found[place], self._others[place] = found, others
        if plausible:
            self._plausible.add(place)

    @property
    def best(self) -> int | None:
        """The accepted place to be called the match, or None."""
        accepted = [place for place, found in self.found.items() if found.accepted]
        if not accepted:
            return None
        nearness = {place: self._nearness(place) for place in accepted}
        # Earlier frames tell one road from another; which of its views is nearest this view alone tells.
        strongest = max(accepted, key=lambda place: (self._joined(place, nearness[place]), -place))
        return max(self._beside(strongest, accepted), key=lambda place: (nearness[place], -place))

    @property
    def certain(self) -> bool:
        """Whether nothing better need be looked for."""
        best = self.best
        return best is not None and self._nearness(best) > _CERTAIN

    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """Plausible places, the best first."""
        best = self.best
        order = sorted(self._plausible, key=lambda place: (place != best, -self._strength(place), place))
        return tuple(
            Hypothesis(
                place,
                self.found[place].T_match_query,
                self._strength(place),
                self._others[place].support,
                self.found[place].accepted,
                self._alone(place),
                self._told(place),
            )
            for place in order
        )

    def ranked(self) -> list[PlaceMatch]:
        """Proposed and accepted places, best first."""
        best = self.best
        accepted = [place for place, found in self.found.items() if found.accepted]
        matches = []
        for place in sorted({*self._pool, *accepted}):
            match = self._pool.get(place, PlaceMatch(place, self._inner(place)))
            found = self.found.get(place)
            if found is not None and found.accepted:
                # The nearest view is named, with the evidence of its neighbours.
                beside = self._beside(place, accepted) if place == best else [place]
                distance = 1.0 - max(self._told(p) for p in beside)
            else:
                doubt = 1.0 - self._strength(place) if place in self._plausible else 1.0
                distance = 1.0 + doubt * match.distance / (1.0 + match.distance)
            matches.append(replace(match, distance=distance, verification=found))
        return sorted(matches, key=lambda m: (m.distance, m.place != best, m.place))

    def _beside(self, place: int, accepted: Sequence[int]) -> list[int]:
        """Accepted views that put the query where this one does, or that are so few frames away that they should."""
        return [other for other in accepted if other == place or self._means_the_same(place, other)]

    def _means_the_same(self, place: int, other: int) -> bool:
        near = abs(place - other) <= _ONE_PLACE
        if self._one_spot is None:
            return near
        told = self._one_spot(place, self.found[place].T_match_query, other, self.found[other].T_match_query)
        return near if told is None else told or (near and not self._slips)

    def _strength(self, place: int) -> float:
        return self._joined(place, self._alone(place))

    def _told(self, place: int) -> float:
        """Strength, averaged with the evidence along the way where that is asked."""
        strength, others = self._strength(place), self._others[place]
        return 0.5 * (strength + others.along_way(self._alone(place))) if others.frames else strength

    def _alone(self, place: int) -> float:
        return self._others[place].heading * evidence_of(self.found[place], self._inner(place))

    def _nearness(self, place: int) -> float:
        return self._others[place].heading * self.found[place].nearness

    def _joined(self, place: int, own: float) -> float:
        """Evidence of the view itself and of earlier ones, as if each were the chance of an independent witness."""
        return 1.0 - (1.0 - own) * (1.0 - self._others[place].support)

    def _inner(self, place: int) -> float:
        """Inner distance of a place, or of its nearest proposal beside it, or else of the worst proposal."""
        if place in self._pool:
            return self._pool[place].distance
        beside = [match.distance for match in self._pool.values() if abs(match.place - place) <= self._spread]
        return min(beside) if beside else max(match.distance for match in self._pool.values())


def _rank(found: Verification) -> tuple[bool, float]:
    return found.accepted, found.agreement


def evidence_of(found: Verification, inner: float) -> float:
    """What one view says for a place, in [0, 1): agreement over what other places reach, and the inner distance."""
    reached = found.reached_elsewhere
    return max(0.0, found.agreement - reached) / (1.0 - reached) / math.sqrt(1.0 + inner)


def distance_of(inner: float, found: Verification) -> float:
    """Distance of a pair of frames, of which nothing else is known."""
    return 1.0 - evidence_of(found, inner) if found.accepted else 1.0 + inner / (1.0 + inner)
