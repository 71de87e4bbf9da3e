"""VerifiedRecognizer: any method, with its best few proposals checked by geometry."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.checked_places import CheckedPlaces, distance_of
from depthprint.errors import SettingsError
from depthprint.polar_view import turn_of_shift
from depthprint.proposals import spread_in_time
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch, PlaceRecognizer, StorableRecognizer
from depthprint.verification.depth_view import DepthView, make_depth_view
from depthprint.verification.temporal_evidence import EarlierFrames, Hypothesis, TemporalEvidence
from depthprint.verification.verifier import GeometricVerifier, judged
from depthprint.verification.view_arrays import pack_view, unpack_view
from depthprint.verification.view_cache import ViewCache

__all__ = ["VerifiedDescription", "VerifiedRecognizer"]

_STEPS = (0, 1, -1)
_PLACES_TRACKED = 3
_MOST_TURN_RAD = math.radians(45)
_FULL_CIRCLE_RAD = 2 * math.pi - 1e-3
# A heading allows a place whose match would keep so much of its evidence.
_ALLOWED_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class VerifiedDescription:
    """What the inner method says of a frame, and the frame as the geometric check keeps it."""

    inner: Any
    view: DepthView


class VerifiedRecognizer:
    """PlaceRecognizer around another: proposals that pass the geometric check come first, by their evidence.

    The distance of an accepted place is 1 - E, below 1, where E joins what this view says (the agreement, over what
    other places often reach, by the inner distance d) with what earlier frames say; that of any other place is
    1 + d / (1 + d), less for a plausible one. d of a place that the inner method did not propose is that of its nearest
    proposal within ``spread`` frames, or else of its worst one.
    Only the best ``k`` proposals, at least ``spread`` frames apart, are checked.
    pool: how many proposals the inner method is asked for; max(k, correlated) * spread when None.
    correlated: the best so many proposals of planar scans, as far apart, are laid over the query, and those that
        correlate best with it come first among those checked. 0 turns it off.
    columns_full_circle: columns of the inner method's shift that make a full turn, where it has one that matters.
    climb: neighbours in time of an accepted place are checked too, and the one seen from nearest is named; with
        ``track``, where none is near, the one that motion puts nearest, on the check of the accepted place.
    track: follow the motion from frame to frame by depth alone. Places that it says are in view are checked first; a
    place where it leads from those of earlier frames needs less agreement, and has their evidence too.
    heading: with ``track``, matches against the heading carried along count for less, and are checked last.
    consistency: without ``track``, places next to those of the last ``consistency`` frames that were queried and then
    added are checked first, from their pose, and need less overlap. 0 turns it off.
    further: gives more proposals of an inner description, their shift a share of the view's width, below a limit;
    checked where none was accepted.
    Raises SettingsError for numbers out of range; MissingExtraError (on query) as GeometricVerifier.
    """

    def __init__(
        self,
        inner: PlaceRecognizer,
        k: int = 5,
        *,
        spread: int = 4,
        pool: int | None = None,
        correlated: int = 0,
        columns_full_circle: int | None = None,
        climb: bool = True,
        consistency: int = 0,
        track: bool = False,
        heading: bool = True,
        further: Callable[..., list[PlaceMatch]] | None = None,
        verifier: GeometricVerifier | None = None,
        views: ViewCache | None = None,
    ) -> None:
        if min(k, spread, 1 if pool is None else pool) < 1 or min(consistency, correlated) < 0:
            raise SettingsError(
                "VerifiedRecognizer: expected k, spread and pool >= 1, consistency and correlated >= 0, "
                f"got {k}, {spread}, {pool}, {consistency} and {correlated}"
            )
        self.inner = inner
        self._k, self._spread, self._climb, self._consistency = k, spread, climb, consistency
        self._pool = max(k, correlated) * spread if pool is None else pool
        self._correlated = correlated
        self._columns = columns_full_circle
        self._verifier = GeometricVerifier() if verifier is None else verifier
        self._make_view = make_depth_view if views is None else views
        self._views: list[DepthView] = []
        self._links: dict[int, Hypothesis] = {}
        self._last: tuple[VerifiedDescription, tuple[Hypothesis, ...]] | None = None
        self._track, self._heading, self._further = track, heading, further
        self._evidence = self._no_evidence()

    def fit(self, images: Sequence[RangeImage]) -> VerifiedRecognizer:
        """Let the inner method learn, and forget all places."""
        self.inner.fit(images)
        self._views, self._links, self._last = [], {}, None
        self._evidence = self._no_evidence()
        return self

    def describe(self, image: RangeImage) -> VerifiedDescription:
        """Describe a frame for the inner method, and thin it for the check."""
        return VerifiedDescription(self.inner.describe(image), self._make_view(image))

    def add(self, description: VerifiedDescription) -> int:
        """Store a place; where the last query was of this description, its match becomes known to the next."""
        number = self.inner.add(description.inner)
        self._views.append(description.view)
        hypotheses: tuple[Hypothesis, ...] | None = None
        if self._last is not None and self._last[0] is description:
            hypotheses = self._last[1]
            if hypotheses and hypotheses[0].accepted:
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
        view = description.view
        checks = CheckedPlaces(pool, self._spread, self._one_spot(view), slips=view.planar)
        for place, pose in self._expected(view, stored).items():
            if checks.certain:
                break
            self._check(checks, description, place, 0.0, (pose,), True)
        promising = [] if checks.certain else self._promising(pool, view)
        for match in spread_in_time(promising, self._k, self._spread):
            if checks.certain:
                break
            if match.place not in checks.found:
                self._check(checks, description, match.place, self._yaw(match, view), (), False)
        if checks.best is None and self._further is not None:
            for match in self._further(description.inner, limit=limit):
                yaw = -(match.shift or 0.0) * view.projection.horizontal_fov_rad
                if match.place not in checks.found and abs(yaw) <= _MOST_TURN_RAD:
                    self._check(checks, description, match.place, yaw, (), False)
        if self._climb and checks.best is not None:
            self._climb_from(checks, description, stored)
        self._last = description, checks.hypotheses()
        matches = checks.ranked()
        return (self._named(matches, view, stored) if self._climb else matches)[:k]

    def distance(self, first: VerifiedDescription, second: VerifiedDescription) -> float:
        """As a place's in ``query``, by what this pair alone says: no earlier frame is asked."""
        inner = self.inner.distance(first.inner, second.inner)
        yaw = None if self._columns is not None else 0.0
        found = self._verifier.verify(first.view, second.view, yaw_rad=yaw)
        return distance_of(inner, found)

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

    def _no_evidence(self) -> TemporalEvidence | None:
        return TemporalEvidence(self._verifier, heading=self._heading) if self._track else None

    def _storable(self) -> StorableRecognizer:
        if not isinstance(self.inner, StorableRecognizer):
            raise SettingsError(f"the places of a {type(self.inner).__name__} cannot be kept in a database")
        return self.inner

    def _check(
        self,
        checks: CheckedPlaces,
        description: VerifiedDescription,
        place: int,
        yaw_rad: float | None,
        starts: Sequence[npt.NDArray[np.float64]],
        seconded: bool,
    ) -> None:
        view, stored = description.view, self._views[place]
        found = self._verifier.verify(view, stored, yaw_rad=yaw_rad, starts=starts, seconded=seconded)
        if self._evidence is None:
            checks.add(place, found, EarlierFrames(), found.accepted)
            return
        plausible = judged(found, stored.settings, seconded=True)
        earlier = EarlierFrames()
        if plausible.accepted:
            earlier = self._evidence.said_before(view, place, found.T_match_query)
        found = judged(found, stored.settings, seconded=earlier.support > stored.settings.min_support)
        checks.add(place, found, earlier, plausible.accepted)

    def _one_spot(self, view: DepthView) -> Callable[..., bool | None] | None:
        # A camera held in the hand sees other things from one spot.
        if self._evidence is None or not view.settings.upright:
            return None
        return partial(self._evidence.one_spot, view.settings)

    def _promising(self, pool: Sequence[PlaceMatch], view: DepthView) -> Sequence[PlaceMatch]:
        """Proposals in the order in which they are to be checked: as proposed, or by what costs less than a check."""
        if self._correlated and view.planar:
            from depthprint.verification.scan_starts import correlation_shares

            pool = spread_in_time(pool, self._correlated, self._spread)
            yaws_rad = [self._yaw(match, view) for match in pool]
            shares = correlation_shares(view, [self._views[match.place] for match in pool], yaws_rad)
            pool = [pool[number] for number in np.argsort(-shares, kind="stable")]
        return self._headed(pool, view)

    def _headed(self, pool: Sequence[PlaceMatch], view: DepthView) -> Sequence[PlaceMatch]:
        """Proposals that the heading allows first; a full circle is seen alike under all headings."""
        if self._evidence is None or view.projection.horizontal_fov_rad > _FULL_CIRCLE_RAD:
            return pool
        share = self._evidence.heading_share
        return sorted(pool, key=lambda m: share(view, m.place, slack_rad=_MOST_TURN_RAD) < _ALLOWED_SHARE)

    def _yaw(self, match: PlaceMatch, view: DepthView) -> float | None:
        """Turn of the query's points that the inner method's shift means; None where it has none."""
        if view.projection.horizontal_fov_rad <= _FULL_CIRCLE_RAD:
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

    def _climb_from(self, checks: CheckedPlaces, description: VerifiedDescription, stored: int) -> None:
        """Check neighbours in time of the best place while the overlap grows, in shrinking steps."""
        led: set[int] = set()
        for step in (4, 2, 1):
            best = checks.best
            if best is None or checks.certain:
                break
            for place in (best - step, best + step):
                if 0 <= place < stored and place not in led and not checks.accepted(place):
                    # A search from nowhere may have refused it before: this pose is better than any of its starts.
                    pose = self._moved(checks.found[best].T_match_query, best, place)
                    self._check(checks, description, place, 0.0, (pose,), False)
                    led.add(place)

    def _named(self, matches: list[PlaceMatch], view: DepthView, stored: int) -> list[PlaceMatch]:
        """The same, where a match seen from afar is named after the place that motion puts nearest to it."""
        best = matches[0]
        found = best.verification
        if self._evidence is None or found is None or not found.accepted:
            return matches
        if found.offset_m <= view.settings.named_within_m:
            return matches
        most_turn_rad = math.pi if view.projection.horizontal_fov_rad > _FULL_CIRCLE_RAD else _MOST_TURN_RAD
        place, pose = self._evidence.nearest_place(
            view, best.place, found.T_match_query, stored, most_turn_rad
        )
        if place == best.place:
            return matches
        reason = f"{found.reason}; found beside place {best.place}"
        beside = replace(found, T_match_query=pose, reason=reason)
        named = replace(best, place=place, shift=None, verification=beside)
        return [named, *(match for match in matches[1:] if match.place != place)]

    def _moved(
        self, T_match_query: npt.NDArray[np.float64], match: int, place: int
    ) -> npt.NDArray[np.float64]:
        """The pose seen from another place, as far as the motion between the two is known."""
        T_place_match = None if self._evidence is None else self._evidence.relative_pose(place, match)
        return T_match_query if T_place_match is None else T_place_match @ T_match_query
