"""TemporalEvidence: what other frames say of a match, by the motion between them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from depthprint.rigid_motion import rotation_angle
from depthprint.verification.depth_odometry import DepthOdometry
from depthprint.verification.depth_view import DepthView
from depthprint.verification.frame_evidence import FrameEvidence
from depthprint.verification.heading import HeadingTrack
from depthprint.verification.hypotheses import Hypothesis, poses_agree, seconded_from_behind
from depthprint.verification.settings import VerificationSettings
from depthprint.verification.turns import Turn, turn_of
from depthprint.verification.verifier import GeometricVerifier

__all__ = ["TemporalEvidence"]

FloatArray = npt.NDArray[np.float64]

# Frames off whose hypotheses are asked, and those whose match is followed.
_REMEMBERED, _FOLLOWED = 16, 10
# Evidence over which a match holds the heading.
_HOLDING = 0.5


class TemporalEvidence:
    """Hypotheses of the last frames, and the heading, carried along by depth odometry.

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
        self._hypotheses.pop(number - 2 * _REMEMBERED, None)

    def of_next(self, view: DepthView) -> FrameEvidence:
        """What earlier frames say of one that is not added yet."""
        latest = len(self._odometry) - 1
        before = self._of(range(latest, latest + 1 - _REMEMBERED, -1))
        return FrameEvidence(
            view,
            self._odometry,
            partial(self._odometry.pose_of_next, view=view),
            before=before,
            after={},
            followed={number: before[number] for number in before if number > latest - _FOLLOWED},
            heading=partial(self.heading_share, view),
        )

    def of(self, number: int, view: DepthView) -> FrameEvidence:
        """What the frames before and after one that was added say of it."""
        after = self._of(range(number + 1, number + _REMEMBERED))
        return FrameEvidence(
            view,
            self._odometry,
            partial(self._odometry.relative_pose, second=number),
            before=self._of(range(number - 1, number - _REMEMBERED, -1)),
            after=seconded_from_behind(after, self._odometry, view.settings),
            followed={later: after[later] for later in after if later <= number + _FOLLOWED},
            heading=partial(self._heading_share_of, number, view.settings.upright),
        )

    def _of(self, numbers: Iterable[int]) -> dict[int, tuple[Hypothesis, ...]]:
        return {number: self._hypotheses[number] for number in numbers if number in self._hypotheses}

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

    def _heading_share_of(self, number: int, upright: bool, place: int, turn_rad: float) -> float:
        if self._headings is None or not upright:
            return 1.0
        return self._headings.share_of(number, place, turn_rad)

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
        return poses_agree(T_first_second @ T_second_query, T_first_query, max(1.0, driven), settings)
