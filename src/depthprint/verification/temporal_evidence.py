"""TemporalEvidence: what the frames before say of a match, by the motion between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.rigid_motion import inverse_pose, rotation_angle
from depthprint.verification.agreement import coarse_overlaps
from depthprint.verification.depth_odometry import DepthOdometry
from depthprint.verification.depth_view import DepthView
from depthprint.verification.heading import HeadingTrack
from depthprint.verification.settings import VerificationSettings
from depthprint.verification.turns import Turn, turn_of
from depthprint.verification.verifier import GeometricVerifier

__all__ = ["EarlierFrames", "Hypothesis", "TemporalEvidence"]

FloatArray = npt.NDArray[np.float64]

# Frames back whose hypotheses are asked, and those whose match is followed.
_REMEMBERED, _FOLLOWED = 16, 10
# Share of its evidence that a hypothesis keeps over one witness distance.
_KEPT = 0.7
# Evidence over which a match holds the heading.
_HOLDING = 0.5


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A place where a frame may have been.

    T_match_query: (4, 4) pose of the frame in the place. strength: evidence in [0, 1) with that of earlier frames,
    support: that of the earlier frames alone. accepted: whether the frame was called a match of the place.
    alone: evidence of the frame without that of earlier ones. told: strength, averaged with the evidence along the way.
    """

    place: int
    T_match_query: FloatArray
    strength: float
    support: float
    accepted: bool
    alone: float = 0.0
    told: float = 0.0


@dataclass(frozen=True)
class EarlierFrames:
    """What earlier frames say of a frame being at a pose in a place.

    support: evidence in [0, 1) of the hypotheses that lead there. frames: those of the way driven last that were asked,
    whether or not they lead there, and evidence: sum of what those that do said alone. heading: share in (0, 1] of its
    own evidence that the frame keeps, by the heading carried along.
    """

    support: float = 0.0
    evidence: float = 0.0
    frames: int = 0
    heading: float = 1.0

    def along_way(self, alone: float) -> float:
        """Mean evidence of the way's frames and of the last, which says ``alone``."""
        return (alone + self.evidence) / (1 + self.frames)


class TemporalEvidence:
    """Hypotheses of the last frames, and the heading, carried along by depth odometry to the next frame.

    Frames are numbered as they are added; places are frames too. Without ``heading`` no match is doubted for its own.
    """

    def __init__(self, verifier: GeometricVerifier, *, heading: bool = True) -> None:
        self._odometry = DepthOdometry(verifier)
        self._headings = HeadingTrack() if heading else None
        self._asked = True
        self._hypotheses: dict[int, tuple[Hypothesis, ...]] = {}

    def add(self, view: DepthView, hypotheses: Sequence[Hypothesis] | None = None) -> None:
        """Append a frame and where it may have been, best first; None where that was not asked."""
        number = len(self._odometry)
        if self._headings is not None:
            self._headings.add(
                self._turn_to(view) if hypotheses is not None else self._odometry.turn_to(view)
            )
            best = hypotheses[0] if hypotheses else None
            if best is not None and best.accepted and best.told > _HOLDING:
                self._headings.hold(best.place, turn_of(best.T_match_query, view.projection))
        self._odometry.add(view)
        if hypotheses is not None:
            self._hypotheses[number] = tuple(hypotheses)
        self._asked = hypotheses is not None
        self._hypotheses.pop(number - _REMEMBERED, None)

    def places_in_view(
        self, view: DepthView, views: Sequence[DepthView], stored: int, count: int, spread: int
    ) -> dict[int, FloatArray]:
        """Places where motion since the last match says the frame is, with the pose T_place_view that it says.

        First the nearest where the sensor's settings ask for it, then up to ``count`` that overlap most, ``spread``
        apart. Empty where nothing was matched lately or odometry broke.
        """
        latest = len(self._odometry) - 1
        for number in range(latest, max(-1, latest - _FOLLOWED), -1):
            link = next((h for h in self._hypotheses.get(number, ()) if h.accepted), None)
            if link is not None:
                break
        else:
            return {}
        T_linked_query = self._odometry.pose_of_next(number, view)
        if T_linked_query is None:
            return {}
        places, poses = self._odometry.places_near(
            link.place, link.T_match_query @ T_linked_query, stored, view.settings.max_offset_m
        )
        pose_of = dict(zip(places.tolist(), poses, strict=True))
        overlaps = {
            place: float(coarse_overlaps(view, views[place], pose[None])[0])
            for place, pose in pose_of.items()
        }
        chosen: list[int] = []
        if pose_of and view.settings.offset_weight == 1.0:
            chosen.append(min(pose_of, key=lambda place: float(np.linalg.norm(pose_of[place][:3, 3]))))
            count += 1
        for place in sorted(overlaps, key=lambda place: (-overlaps[place], place)):
            if len(chosen) < count and all(abs(place - other) >= spread for other in chosen):
                chosen.append(place)
        return {place: pose_of[place] for place in chosen}

    def heading_share(
        self, view: DepthView, place: int, turn_rad: float = 0.0, slack_rad: float = 0.0
    ) -> float:
        """Share in (0, 1] of its evidence that a match of a frame not added yet keeps, by the headings of both.

        turn_rad: of the match, to the left. slack_rad: that much off is not off. 1 for a sensor held in the hand, which
        turns about any axis.
        """
        if self._headings is None or not view.settings.upright:
            return 1.0
        return self._headings.share(place, turn_rad, self._turn_to(view), slack_rad)

    def _turn_to(self, view: DepthView) -> Turn:
        """Turn to a frame that is asked: after places that were not, of a map, it may start elsewhere."""
        turn = self._odometry.turn_to(view)
        latest = len(self._odometry) - 1
        if self._asked or self._odometry.pose_of_next(latest, view) is not None:
            return turn
        return Turn(turn.left_rad, math.pi**2)

    def relative_pose(self, first: int, second: int) -> FloatArray | None:
        """T_first_second (4, 4) of two frames by odometry, or None where it broke between them."""
        return self._odometry.relative_pose(first, second)

    def nearest_place(
        self, view: DepthView, place: int, T_place_view: FloatArray, stored: int, most_turn_rad: float
    ) -> tuple[int, FloatArray]:
        """Of the places below ``stored`` that odometry joins to one, the nearest to a pose in it, and the pose there.

        Among those turned by at most ``most_turn_rad``; the place itself where there is none.
        """
        places, poses = self._odometry.places_near(place, T_place_view, stored, view.settings.max_offset_m)
        turned_alike = rotation_angle(poses) <= most_turn_rad
        if not turned_alike.any():
            return place, T_place_view
        nearest = int(np.argmin(np.where(turned_alike, np.linalg.norm(poses[:, :3, 3], axis=1), np.inf)))
        return int(places[nearest]), poses[nearest]

    def one_spot(
        self,
        settings: VerificationSettings,
        first: int,
        T_first_query: FloatArray,
        second: int,
        T_second_query: FloatArray,
    ) -> bool | None:
        """Whether two places, each with the pose of a frame in it, mean one spot; None where odometry cannot tell."""
        T_first_second = self._odometry.relative_pose(first, second)
        if T_first_second is None:
            return None
        driven = float(np.linalg.norm(T_first_second[:3, 3])) / settings.witness_m
        return _agree(T_first_second @ T_second_query, T_first_query, max(1.0, driven), settings)

    def said_before(self, view: DepthView, place: int, T_match_query: FloatArray) -> EarlierFrames:
        """What earlier frames say of a frame not added yet being at a pose in a place.

        A hypothesis counts when it, moved by odometry, leads there within tolerance. One from further back than the
        witness distance supports by its strength, as an independent view; a nearer one saw nearly the same, and
        counts less the nearer it is, but hands on its own support. All fade with the distance driven.
        """
        settings = view.settings
        support, evidence, frames = 0.0, 0.0, 0
        latest = len(self._odometry) - 1
        for number in range(latest, max(-1, latest + 1 - _REMEMBERED), -1):
            hypotheses = self._hypotheses.get(number)
            if hypotheses is None or not (hypotheses or settings.way_m):
                continue
            T_number_query = self._odometry.pose_of_next(number, view)
            if T_number_query is None:
                break
            driven_m = float(np.linalg.norm(T_number_query[:3, 3]))
            driven = driven_m / settings.witness_m
            said = 0.0
            for hypothesis in hypotheses:
                T_place_match = self._odometry.relative_pose(place, hypothesis.place)
                if T_place_match is None:
                    continue
                T_expected = T_place_match @ hypothesis.T_match_query @ T_number_query
                if _agree(T_expected, T_match_query, max(1.0, driven), settings):
                    witness = min(1.0, driven) * _KEPT ** max(1.0, driven) * hypothesis.strength
                    support = max(support, witness, _KEPT**driven * hypothesis.support)
                    said = max(said, hypothesis.alone)
            if driven_m < settings.way_m:
                evidence, frames = evidence + said, frames + 1
        heading = self.heading_share(view, place, turn_of(T_match_query, view.projection))
        return EarlierFrames(support, evidence, frames, heading)


def _agree(first: FloatArray, second: FloatArray, slack: float, settings: VerificationSettings) -> bool:
    apart = inverse_pose(first) @ second
    metres = float(np.linalg.norm(apart[:3, 3]))
    return (
        metres <= slack * settings.agreeing_m
        and float(rotation_angle(apart)) <= slack * settings.agreeing_rad
    )
