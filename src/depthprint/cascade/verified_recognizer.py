"""VerifiedRecognizer: any method, with its best few proposals checked by geometry."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.cascade.checked_places import distance_of
from depthprint.cascade.checked_query import MOST_TURN_RAD, CheckedQuery
from depthprint.cascade.proposals import spread_in_time
from depthprint.errors import SettingsError
from depthprint.polar_view import turn_of_shift
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch, PlaceRecognizer, StorableRecognizer
from depthprint.verification.depth_view import DepthView, make_depth_view
from depthprint.verification.hypotheses import Hypothesis
from depthprint.verification.temporal_evidence import TemporalEvidence
from depthprint.verification.verifier import GeometricVerifier
from depthprint.verification.view_arrays import pack_view, unpack_view
from depthprint.verification.view_cache import ViewCache

__all__ = ["RECONSIDERED", "VerifiedDescription", "VerifiedRecognizer"]

_STEPS = (0, 1, -1)
_PLACES_TRACKED = 3
# Frames that are kept to be asked again.
RECONSIDERED = 16
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
        self._last: tuple[VerifiedDescription, CheckedQuery | None] | None = None
        self._asked: dict[int, CheckedQuery | None] = {}
        self._track, self._heading, self._further = track, heading, further
        self._evidence = self._no_evidence()

    def fit(self, images: Sequence[RangeImage]) -> VerifiedRecognizer:
        """Let the inner method learn, and forget all places."""
        self.inner.fit(images)
        self._views, self._links, self._last, self._asked = [], {}, None, {}
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
            query = self._asked[number] = self._last[1]
            hypotheses = () if query is None else query.checks.hypotheses()
            if hypotheses and hypotheses[0].accepted:
                self._links[number] = hypotheses[0]
        if self._evidence is not None:
            self._evidence.add(description.view, hypotheses)
        self._asked.pop(number - RECONSIDERED, None)
        self._last = None
        return number

    def query(
        self, description: VerifiedDescription, k: int = 1, limit: int | None = None
    ) -> list[PlaceMatch]:
        """Best places: accepted ones by their evidence, then the others by the inner distance."""
        pool = self.inner.query(description.inner, max(k, self._pool), limit)
        self._last = description, None
        if not pool:
            return []
        stored = len(self._views) if limit is None else min(limit, len(self._views))
        view = description.view
        query = CheckedQuery(view, pool, self._spread, self._views, stored, self._verifier, self._evidence)
        checks = query.checks
        if self._evidence is None:
            self._check_neighbours(query)
        query.check_expected(_PLACES_TRACKED)
        promising = [] if checks.certain else self._promising(pool, view)
        for match in spread_in_time(promising, self._k, self._spread):
            if checks.certain:
                break
            if match.place not in checks.found:
                query.check(match.place, self._yaw(match, view))
        if checks.best is None and self._further is not None:
            for match in self._further(description.inner, limit=limit):
                yaw = -(match.shift or 0.0) * view.projection.horizontal_fov_rad
                if match.place not in checks.found and abs(yaw) <= MOST_TURN_RAD:
                    query.check(match.place, yaw)
        self._last = description, query
        return self._answer(query)[:k]

    def reconsider(self, number: int, k: int = 1) -> list[PlaceMatch]:
        """Best places of a frame that was queried and then added, by what the frames since say too.

        As the query said without ``track``. Raises SettingsError for a frame that is not one of the last 16 or was not
        queried.
        """
        if number not in self._asked:
            raise SettingsError(
                f"reconsider: expected one of the last {RECONSIDERED} frames, queried and then added, "
                f"got frame {number}"
            )
        query = self._asked[number]
        if query is None:
            return []
        if self._evidence is not None:
            query = query.again(self._evidence.of(number, query.view))
            query.check_expected(_PLACES_TRACKED)
        return self._answer(query)[:k]

    def _answer(self, query: CheckedQuery) -> list[PlaceMatch]:
        if not self._climb:
            return query.checks.ranked()
        query.climb()
        return query.named_by_motion()

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
        if self._evidence is None or view.full_circle:
            return pool
        share = self._evidence.heading_share
        return sorted(pool, key=lambda m: share(view, m.place, slack_rad=MOST_TURN_RAD) < _ALLOWED_SHARE)

    def _yaw(self, match: PlaceMatch, view: DepthView) -> float | None:
        """Turn of the query's points that the inner method's shift means; None where it has none."""
        if not view.full_circle:
            return 0.0
        if self._columns is None or match.shift is None:
            return None
        return turn_of_shift(match.shift, self._columns)

    def _check_neighbours(self, query: CheckedQuery) -> None:
        """Check places next to those of the last frames, where the motion is not followed."""
        latest = len(self._views) - 1
        for number in range(latest, max(-1, latest - self._consistency), -1):
            link = self._links.get(number)
            if link is None:
                continue
            for place in (link.place + step for step in _STEPS):
                if 0 <= place < query.stored and not query.checks.certain:
                    query.check(place, starts=(link.T_match_query,), seconded=True)
            break
