"""CheckedQuery: one query of which places are checked by geometry, with what other frames say of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from depthprint.cascade.checked_places import CheckedPlaces
from depthprint.recognizer import PlaceMatch
from depthprint.verification.depth_view import DepthView
from depthprint.verification.frame_evidence import FrameEvidence
from depthprint.verification.hypotheses import OtherFrames
from depthprint.verification.temporal_evidence import TemporalEvidence
from depthprint.verification.verifier import GeometricVerifier, Verification, judged

__all__ = ["MOST_TURN_RAD", "CheckedQuery"]

FloatArray = npt.NDArray[np.float64]

# Views ahead that are turned by more share too little.
MOST_TURN_RAD = math.radians(45)


class CheckedQuery:
    """A query's view, and its checks against the first ``stored`` of ``views``.

    pool: the proposals, at least ``spread`` frames of which are between any two that are checked.
    evidence: motion and matches of all frames, None where the motion is not followed.
    """

    def __init__(
        self,
        view: DepthView,
        pool: Sequence[PlaceMatch],
        spread: int,
        views: Sequence[DepthView],
        stored: int,
        verifier: GeometricVerifier,
        evidence: TemporalEvidence | None,
    ) -> None:
        self.view, self.stored = view, stored
        self._pool, self._spread, self._views = pool, spread, views
        self._verifier, self._evidence = verifier, evidence
        self.frames = None if evidence is None else evidence.of_next(view)
        self.checks = self._no_checks()

    def check(
        self,
        place: int,
        yaw_rad: float | None = 0.0,
        starts: Sequence[FloatArray] = (),
        seconded: bool = False,
    ) -> None:
        """Check a place; arguments as of ``GeometricVerifier.verify``."""
        self._weigh(
            place,
            self._verifier.verify(
                self.view, self._views[place], yaw_rad=yaw_rad, starts=starts, seconded=seconded
            ),
        )

    def check_expected(self, count: int) -> None:
        """Check up to ``count`` places, and the nearest, where the motion from another frame's match leads."""
        if self.frames is None:
            return
        led_to = self.frames.places_in_view(self._views, self.stored, count, self._spread)
        for place, pose in led_to.items():
            if self.checks.certain:
                break
            self.check(place, starts=(pose,), seconded=True)

    def climb(self) -> None:
        """Check neighbours in time of the best place while the overlap grows, in shrinking steps."""
        led: set[int] = set()
        for step in (4, 2, 1):
            best = self.checks.best
            if best is None or self.checks.certain:
                break
            for place in (best - step, best + step):
                if 0 <= place < self.stored and place not in led and not self.checks.accepted(place):
                    # A search from nowhere may have refused it before: this pose is better than any of its starts.
                    self.check(place, starts=(self._moved(best, place),))
                    led.add(place)

    def again(self, frames: FrameEvidence) -> CheckedQuery:
        """The same query and what was found, weighed by what other frames say by now."""
        query = CheckedQuery(
            self.view, self._pool, self._spread, self._views, self.stored, self._verifier, self._evidence
        )
        query.frames = frames
        for place, found in self.checks.found.items():
            query._weigh(place, found)
        return query

    def named_by_motion(self) -> list[PlaceMatch]:
        """Places, best first; a match seen from afar is named after the place that motion puts nearest to it."""
        matches = self.checks.ranked()
        best, settings = matches[0], self.view.settings
        found = best.verification
        if self._evidence is None or found is None or not found.accepted:
            return matches
        if found.offset_m <= settings.named_within_m:
            return matches
        most_turn_rad = math.pi if self.view.full_circle else MOST_TURN_RAD
        place, pose = self._evidence.nearest_place(
            self.view, best.place, found.T_match_query, self.stored, most_turn_rad
        )
        if place == best.place:
            return matches
        reason = f"{found.reason}; found beside place {best.place}"
        beside = replace(found, T_match_query=pose, reason=reason)
        named = replace(best, place=place, shift=None, verification=beside)
        return [named, *(match for match in matches[1:] if match.place != place)]

    def _no_checks(self) -> CheckedPlaces:
        one_spot = None
        # A camera held in the hand sees other things from one spot.
        if self._evidence is not None and self.view.settings.upright:
            one_spot = partial(self._evidence.one_spot, self.view.settings)
        return CheckedPlaces(self._pool, self._spread, one_spot, slips=self.view.planar)

    def _weigh(self, place: int, found: Verification) -> None:
        """Take in a check, with what other frames say of the pose found."""
        if self.frames is None:
            self.checks.add(place, found, OtherFrames(), found.accepted)
            return
        settings = self._views[place].settings
        plausible = judged(found, settings, seconded=True).accepted
        others = self.frames.said(place, found.T_match_query) if plausible else OtherFrames()
        found = judged(found, settings, seconded=others.support > settings.min_support)
        self.checks.add(place, found, others, plausible)

    def _moved(self, match: int, place: int) -> FloatArray:
        """The pose in another place than its match, as far as the motion between the two is known."""
        T_match_query = self.checks.found[match].T_match_query
        T_place_match = None if self._evidence is None else self._evidence.relative_pose(place, match)
        return T_match_query if T_place_match is None else T_place_match @ T_match_query
