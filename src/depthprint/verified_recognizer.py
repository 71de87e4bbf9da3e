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
from depthprint.verification.agreement import coarse_overlaps
from depthprint.verification.depth_odometry import DepthOdometry
from depthprint.verification.depth_view import DepthView, make_depth_view
from depthprint.verification.verifier import GeometricVerifier, Verification
from depthprint.verification.view_arrays import pack_view, unpack_view
from depthprint.verification.view_cache import ViewCache

__all__ = ["VerifiedDescription", "VerifiedRecognizer"]

_STEPS = (0, 1, -1)
_FRAMES_TRACKED, _PLACES_TRACKED = 10, 3
# With this much nearness nothing better is looked for.
_CERTAIN = 0.6


@dataclass(frozen=True, eq=False)
class VerifiedDescription:
    """What the inner method says of a frame, and the frame as the geometric check keeps it."""

    inner: Any
    view: DepthView


@dataclass(frozen=True)
class _Link:
    """A stored place whose query was accepted at ``place``."""

    place: int
    T_match_query: npt.NDArray[np.float64]


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
    Raises SettingsError for numbers out of range; MissingExtraError (on query) as GeometricVerifier.
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
        self._links: dict[int, _Link] = {}
        self._last: tuple[VerifiedDescription, _Link] | None = None
        self._track = track
        self._odometry = DepthOdometry(self._verifier) if track else None

    def fit(self, images: Sequence[RangeImage]) -> VerifiedRecognizer:
        """Let the inner method learn, and forget all places."""
        self.inner.fit(images)
        self._views, self._links, self._last = [], {}, None
        self._odometry = DepthOdometry(self._verifier) if self._track else None
        return self

    def describe(self, image: RangeImage) -> VerifiedDescription:
        """Describe a frame for the inner method, and thin it for the check."""
        return VerifiedDescription(self.inner.describe(image), self._make_view(image))

    def add(self, description: VerifiedDescription) -> int:
        """Store a place; where the last query was of this description, its match becomes known to the next."""
        number = self.inner.add(description.inner)
        self._views.append(description.view)
        if self._odometry is not None:
            self._odometry.add(description.view)
        if self._last is not None and self._last[0] is description:
            self._links[number] = self._last[1]
        self._last = None
        return number

    def query(
        self, description: VerifiedDescription, k: int = 1, limit: int | None = None
    ) -> list[PlaceMatch]:
        """Best places: accepted ones by agreement, then the others by the inner distance."""
        pool = self.inner.query(description.inner, max(k, self._pool), limit)
        self._last = None
        if not pool:
            return []
        stored = len(self._views) if limit is None else min(limit, len(self._views))
        checked: dict[int, Verification] = {}
        seconded = self._tracked(description.view, stored) or self._seconded(stored)
        for place, pose in seconded.items():
            if any(v.accepted and v.nearness > _CERTAIN for v in checked.values()):
                break
            checked[place] = self._check(description, place, 0.0, (pose,), True)
        for match in spread_in_time(pool, self._k, self._spread):
            best = _best(checked)
            if best is not None and checked[best].nearness > _CERTAIN:
                break
            if match.place not in checked:
                yaw = self._yaw(match, description.view)
                checked[match.place] = self._check(description, match.place, yaw, (), False)
        best = _best(checked)
        if best is not None and self._climb:
            self._climb_from(description, best, checked, stored)
            best = _best(checked)
        if best is not None:
            self._last = description, _Link(best, checked[best].T_match_query)
        return self._ranked(description, pool, checked)[:k]

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
        description: VerifiedDescription,
        place: int,
        yaw_rad: float | None,
        starts: Sequence[npt.NDArray[np.float64]],
        seconded: bool,
    ) -> Verification:
        return self._verifier.verify(
            description.view, self._views[place], yaw_rad=yaw_rad, starts=starts, seconded=seconded
        )

    def _yaw(self, match: PlaceMatch, view: DepthView) -> float | None:
        """Turn of the query's points that the inner method's shift means; None where it has none."""
        if view.projection.horizontal_fov_rad < 2 * math.pi - 1e-3:
            return 0.0
        if self._columns is None or match.shift is None:
            return None
        return turn_of_shift(match.shift, self._columns)

    def _seconded(self, stored: int) -> dict[int, npt.NDArray[np.float64]]:
        """Places next to the matches of the last frames, with the pose found there."""
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

    def _tracked(self, view: DepthView, stored: int) -> dict[int, npt.NDArray[np.float64]]:
        """Places that odometry since the last match says are in view, with the poses it says, most overlap first."""
        latest = len(self._views) - 1
        recent = range(latest, max(-1, latest - _FRAMES_TRACKED), -1)
        number = next((number for number in recent if number in self._links), None)
        if self._odometry is None or number is None:
            return {}
        T_linked_query = self._odometry.pose_of_next(number, view)
        if T_linked_query is None:
            return {}
        link = self._links[number]
        places, T_place_match = self._odometry.relative_poses(link.place, stored)
        poses = T_place_match @ link.T_match_query @ T_linked_query
        near = np.linalg.norm(poses[:, :3, 3], axis=1) < view.settings.max_offset_m
        overlaps = {
            int(place): float(coarse_overlaps(view, self._views[place], pose[None])[0])
            for place, pose in zip(places[near], poses[near], strict=True)
        }
        by_overlap = sorted(overlaps, key=lambda place: (-overlaps[place], place))
        chosen: list[int] = []
        for place in by_overlap:
            if len(chosen) < _PLACES_TRACKED and all(abs(place - other) >= self._spread for other in chosen):
                chosen.append(place)
        pose_of = dict(zip(places.tolist(), poses, strict=True))
        return {place: pose_of[place] for place in chosen}

    def _climb_from(
        self, description: VerifiedDescription, best: int, checked: dict[int, Verification], stored: int
    ) -> None:
        """Check neighbours in time of the best place while the overlap grows, in shrinking steps."""
        for step in (4, 2, 1):
            if checked[best].nearness > _CERTAIN:
                break
            pose = checked[best].T_match_query
            for place in (best - step, best + step):
                if 0 <= place < stored and place not in checked:
                    checked[place] = self._check(description, place, 0.0, (pose,), False)
            better = _best(checked)
            best = best if better is None else better

    def _ranked(
        self, description: VerifiedDescription, pool: list[PlaceMatch], checked: dict[int, Verification]
    ) -> list[PlaceMatch]:
        by_place = {match.place: match for match in pool}
        found = []
        for place in sorted({*by_place, *(p for p, v in checked.items() if v.accepted)}):
            match = by_place.get(place, PlaceMatch(place, self._inner_distance(place, pool)))
            verification = checked.get(place)
            distance = _distance(match.distance, verification)
            found.append(replace(match, distance=distance, verification=verification))
        return sorted(found, key=lambda m: (m.distance, m.place))

    def _inner_distance(self, place: int, pool: list[PlaceMatch]) -> float:
        """Distance for a place that was not proposed."""
        beside = [match.distance for match in pool if abs(match.place - place) <= self._spread]
        return min(beside) if beside else max(match.distance for match in pool)


def _best(checked: dict[int, Verification]) -> int | None:
    accepted = [place for place, v in checked.items() if v.accepted]
    return max(accepted, key=lambda place: (checked[place].nearness, -place), default=None)


def _distance(inner: float, verification: Verification | None) -> float:
    if verification is not None and verification.accepted:
        return 1.0 - verification.agreement / (1.0 + inner)
    return 1.0 + inner / (1.0 + inner)
