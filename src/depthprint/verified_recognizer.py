"""VerifiedRecognizer: any method, with its best few proposals checked by geometry."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import SettingsError
from depthprint.polar_view import turn_of_shift
from depthprint.proposals import spread_in_time
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch, PlaceRecognizer, StorableRecognizer
from depthprint.verification.depth_view import DepthView, make_depth_view
from depthprint.verification.temporal_evidence import Hypothesis, TemporalEvidence
from depthprint.verification.verifier import GeometricVerifier, Verification, judged
from depthprint.verification.view_arrays import pack_view, unpack_view
from depthprint.verification.view_cache import ViewCache

__all__ = ["VerifiedDescription", "VerifiedRecognizer"]

_STEPS = (0, 1, -1)
_PLACES_TRACKED = 3
# With this much nearness nothing better is looked for.
_CERTAIN = 0.5
# Agreement that wrong places of the same shape often reach.
_REACHED_ELSEWHERE = 0.4
# Accepted places that are at most so many frames apart are one place, seen from nearer and further.
_ONE_PLACE = 10


@dataclass(frozen=True, eq=False)
class VerifiedDescription:
    """What the inner method says of a frame, and the frame as the geometric check keeps it."""

    inner: Any
    view: DepthView


class VerifiedRecognizer:
    """PlaceRecognizer around another: proposals that pass the geometric check come first, by their agreement.

    The distance of an accepted place is 1 - agreement / (1 + d), below 1; that of any other is 1 + d / (1 + d). d is
    the inner method's distance; for a place that it did not propose, that of its nearest proposal within ``spread``
    frames, or else of its worst one. Only the best ``k`` proposals, at least ``spread`` frames apart, are checked.
    pool: how many proposals the inner method is asked for; k * spread when None.
    columns_full_circle: columns of the inner method's shift that make a full turn, where it has one that matters.
    climb: an accepted place gives way to a neighbour in time of greater agreement.
    consistency: places next to those of the last ``consistency`` frames that were queried and then added are checked
    first, from their pose, and need less overlap. 0 turns it off.
    track: follow the motion from frame to frame by depth alone, and check first the places that it says are in view.
    Raises SettingsError for numbers out of range; MissingExtraError (on query) without small_gicp.
    """

    def __init__(
        self,
        inner: PlaceRecognizer,
        k: int = 5,
        *,
        spread: int = 4,
        pool: int | None = None,
        columns_full_circle: int | None = None,
        climb: bool = True,
        consistency: int = 0,
        track: bool = False,
        verifier: GeometricVerifier | None = None,
        views: ViewCache | None = None,
    ) -> None:
        if min(k, spread, 1 if pool is None else pool) < 1 or consistency < 0:
            raise SettingsError(
                "VerifiedRecognizer: expected k, spread and pool >= 1 and consistency >= 0, "
                f"got {k}, {spread}, {pool} and {consistency}"
            )
        self.inner = inner
        self._k, self._spread, self._climb, self._consistency = k, spread, climb, consistency
        self._pool = k * spread if pool is None else pool
        self._columns = columns_full_circle
        self._verifier = GeometricVerifier() if verifier is None else verifier
        self._make_view = make_depth_view if views is None else views
        self._views: list[DepthView] = []
        self._links: dict[int, Hypothesis] = {}
        self._last: tuple[VerifiedDescription, tuple[Hypothesis, ...]] | None = None
        self._track = track
        self._evidence = TemporalEvidence(self._verifier) if track else None

    def fit(self, images: Sequence[RangeImage]) -> VerifiedRecognizer:
        """Let the inner method learn, and forget all places."""
        self.inner.fit(images)
        self._views, self._links, self._last = [], {}, None
        self._evidence = TemporalEvidence(self._verifier) if self._track else None
        return self

    def describe(self, image: RangeImage) -> VerifiedDescription:
        """Describe a frame for the inner method, and thin it for the check."""
        return VerifiedDescription(self.inner.describe(image), self._make_view(image))

    def add(self, description: VerifiedDescription) -> int:
        """Store a place; where the last query was of this description, its match becomes known to the next."""
        number = self.inner.add(description.inner)
        self._views.append(description.view)
        hypotheses: tuple[Hypothesis, ...] = ()
        if self._last is not None and self._last[0] is description:
            hypotheses = self._last[1]
            if hypotheses[0].accepted:
                self._links[number] = hypotheses[0]
        if self._evidence is not None:
            self._evidence.add(description.view, hypotheses)
        self._last = None
        return number

    def query(
        self, description: VerifiedDescription, k: int = 1, limit: int | None = None
    ) -> list[PlaceMatch]:
        """Best places: accepted ones by their evidence, then the others by the inner distance."""
        pool = self.inner.query(description.inner, max(k, self._pool), limit)
        self._last = None
        if not pool:
            return []
        stored = len(self._views) if limit is None else min(limit, len(self._views))
        checks = _Checks(pool, self._spread)
        for place, pose in self._expected(description.view, stored).items():
            if checks.certain:
                break
            self._check(checks, description, place, 0.0, (pose,), True)
        for match in spread_in_time(pool, self._k, self._spread):
            if checks.certain:
                break
            if match.place not in checks.found:
                self._check(checks, description, match.place, self._yaw(match, description.view), (), False)
        if self._climb and checks.best is not None:
            self._climb_from(checks, description, stored)
        hypotheses = checks.hypotheses()
        if hypotheses:
            self._last = description, hypotheses
        return checks.ranked()[:k]

    def distance(self, first: VerifiedDescription, second: VerifiedDescription) -> float:
        """1 - agreement / (1 + d) where the pair passes the check, else 1 + d / (1 + d), of the inner distance d."""
        inner = self.inner.distance(first.inner, second.inner)
        yaw = None if self._columns is not None else 0.0
        found = self._verifier.verify(first.view, second.view, yaw_rad=yaw)
        return _distance(inner, found)

    @property
    def fingerprint(self) -> str:
        """Fingerprint of the inner method; SettingsError where it has none, since its places cannot be stored."""
        return self._storable().fingerprint

    def pack(self, description: VerifiedDescription) -> dict[str, npt.NDArray[Any]]:
        """Arrays of the inner method's description and of the view, for a place database."""
        return self._storable().pack(description.inner) | pack_view(description.view)

    def unpack(self, arrays: Mapping[str, npt.NDArray[Any]]) -> VerifiedDescription:
        """The description that ``pack`` took apart."""
        return VerifiedDescription(self._storable().unpack(arrays), unpack_view(arrays))

    def _storable(self) -> StorableRecognizer:
        if not isinstance(self.inner, StorableRecognizer):
            raise SettingsError(f"the places of a {type(self.inner).__name__} cannot be kept in a database")
        return self.inner

    def _check(
        self,
        checks: _Checks,
        description: VerifiedDescription,
        place: int,
        yaw_rad: float | None,
        starts: Sequence[npt.NDArray[np.float64]],
        seconded: bool,
    ) -> None:
        view, stored = description.view, self._views[place]
        found = self._verifier.verify(view, stored, yaw_rad=yaw_rad, starts=starts, seconded=seconded)
        if self._evidence is None:
            checks.add(place, found, 0.0, found.accepted)
            return
        plausible = judged(found, stored.settings, seconded=True)
        support = 0.0
        if plausible.accepted:
            support = self._evidence.support(view, place, found.T_match_query)
        found = plausible if support else judged(found, stored.settings, seconded=False)
        checks.add(place, found, support, plausible.accepted)

    def _yaw(self, match: PlaceMatch, view: DepthView) -> float | None:
        """Turn of the query's points that the inner method's shift means; None where it has none."""
        if view.projection.horizontal_fov_rad < 2 * math.pi - 1e-3:
            return 0.0
        if self._columns is None or match.shift is None:
            return None
        return turn_of_shift(match.shift, self._columns)

    def _expected(self, view: DepthView, stored: int) -> dict[int, npt.NDArray[np.float64]]:
        """Places to check before any proposal, with poses to start from."""
        if self._evidence is not None:
            return self._evidence.places_in_view(view, self._views, stored, _PLACES_TRACKED, self._spread)
        places: dict[int, npt.NDArray[np.float64]] = {}
        latest = len(self._views) - 1
        for number in range(latest, max(-1, latest - self._consistency), -1):
            link = self._links.get(number)
            if link is not None:
                for step in _STEPS:
                    if 0 <= link.place + step < stored:
                        places.setdefault(link.place + step, link.T_match_query)
                break
        return places

    def _climb_from(self, checks: _Checks, description: VerifiedDescription, stored: int) -> None:
        """Check neighbours in time of the best place while the overlap grows, in shrinking steps."""
        for step in (4, 2, 1):
            best = checks.best
            if best is None or checks.certain:
                break
            for place in (best - step, best + step):
                if 0 <= place < stored and place not in checks.found:
                    pose = self._moved(checks.found[best].T_match_query, best, place)
                    self._check(checks, description, place, 0.0, (pose,), False)

    def _moved(
        self, T_match_query: npt.NDArray[np.float64], match: int, place: int
    ) -> npt.NDArray[np.float64]:
        """The pose seen from another place, as far as the motion between the two is known."""
        T_place_match = None if self._evidence is None else self._evidence.relative_pose(place, match)
        return T_match_query if T_place_match is None else T_place_match @ T_match_query


class _Checks:
    """Places that one query was checked against, and what that says."""

    def __init__(self, pool: Sequence[PlaceMatch], spread: int) -> None:
        self.found: dict[int, Verification] = {}
        self._support: dict[int, float] = {}
        self._plausible: set[int] = set()
        self._pool = {match.place: match for match in pool}
        self._spread = spread

    def add(self, place: int, found: Verification, support: float, plausible: bool) -> None:
        self.found[place], self._support[place] = found, support
        if plausible:
            self._plausible.add(place)

    @property
    def best(self) -> int | None:
        """The accepted place to be called the match, or None."""
        accepted = [place for place, found in self.found.items() if found.accepted]
        return max(
            accepted,
            key=lambda place: (self._joined(place, self.found[place].nearness), -place),
            default=None,
        )

    @property
    def certain(self) -> bool:
        """Whether nothing better need be looked for."""
        best = self.best
        return best is not None and self.found[best].nearness > _CERTAIN

    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """Plausible places, the best first."""
        order = sorted(self._plausible, key=lambda place: (place != self.best, -self._strength(place), place))
        return tuple(
            Hypothesis(
                place,
                self.found[place].T_match_query,
                self._strength(place),
                self._support[place],
                self.found[place].accepted,
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
                beside = [p for p in accepted if abs(p - place) <= _ONE_PLACE] if place == best else [place]
                distance = 1.0 - max(self._strength(p) for p in beside)
            else:
                doubt = 1.0 - self._strength(place) if place in self._plausible else 1.0
                distance = 1.0 + doubt * match.distance / (1.0 + match.distance)
            matches.append(replace(match, distance=distance, verification=found))
        return sorted(matches, key=lambda m: (m.distance, m.place != best, m.place))

    def _strength(self, place: int) -> float:
        return self._joined(place, _evidence(self.found[place], self._inner(place)))

    def _joined(self, place: int, own: float) -> float:
        """Evidence of the view itself and of earlier ones, as if each were the chance of an independent witness."""
        return 1.0 - (1.0 - own) * (1.0 - self._support[place])

    def _inner(self, place: int) -> float:
        """Inner distance of a place, or of its nearest proposal beside it, or else of the worst proposal."""
        if place in self._pool:
            return self._pool[place].distance
        beside = [match.distance for match in self._pool.values() if abs(match.place - place) <= self._spread]
        return min(beside) if beside else max(match.distance for match in self._pool.values())


def _evidence(found: Verification, inner: float) -> float:
    """What one view says for a place, in [0, 1): agreement over what other places reach, and the inner distance."""
    return (
        max(0.0, found.agreement - _REACHED_ELSEWHERE) / (1.0 - _REACHED_ELSEWHERE) / math.sqrt(1.0 + inner)
    )


def _distance(inner: float, found: Verification) -> float:
    return 1.0 - _evidence(found, inner) if found.accepted else 1.0 + inner / (1.0 + inner)
