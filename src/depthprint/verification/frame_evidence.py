"""FrameEvidence: what other frames say of one, whether it is the next or was added a while ago."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.verification.agreement import coarse_overlaps
from depthprint.verification.depth_odometry import DepthOdometry
from depthprint.verification.depth_view import DepthView
from depthprint.verification.hypotheses import Hypotheses, OtherFrames, said_by
from depthprint.verification.turns import turn_of

__all__ = ["FrameEvidence"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FrameEvidence:
    """Hypotheses about one frame.

    pose_in: T_number_view (4, 4) of the frame in another, None where odometry broke between them.
    before, after: hypotheses of earlier and of later frames, the nearest first. followed: those of which the first
    accepted match says where the frame is. heading: share of its evidence that a match with a place keeps, which turns
    so many radians to the left.
    """

    view: DepthView
    odometry: DepthOdometry
    pose_in: Callable[[int], FloatArray | None]
    before: Hypotheses
    after: Hypotheses
    followed: Hypotheses
    heading: Callable[[int, float], float]

    def said(self, place: int, T_place_view: FloatArray) -> OtherFrames:
        """What the other frames say of this one's being at a pose (4, 4) in a place, as ``said_by``."""
        settings = self.view.settings
        before, after = (
            said_by(hypotheses, place, T_place_view, self.pose_in, self.odometry, settings)
            for hypotheses in (self.before, self.after)
        )
        share = self.heading(place, turn_of(T_place_view, self.view.projection))
        return before.joined(after).joined(OtherFrames(heading=share))

    def places_in_view(
        self, views: Sequence[DepthView], stored: int, count: int, spread: int
    ) -> dict[int, FloatArray]:
        """Places below ``stored`` where motion from a match says the frame is, with the pose T_place_view that it says.

        First the nearest where the sensor's settings ask for it, then up to ``count`` that overlap most, ``spread``
        apart. Empty where none of the frames followed was matched, or odometry broke.
        """
        T_place_view = self._followed_pose()
        if T_place_view is None:
            return {}
        view = self.view
        places, poses = self.odometry.places_near(*T_place_view, stored, view.settings.max_offset_m)
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

    def _followed_pose(self) -> tuple[int, FloatArray] | None:
        """A place, and the pose of the frame in it by the first accepted match of those followed."""
        for number, hypotheses in self.followed.items():
            link = next((h for h in hypotheses if h.accepted), None)
            if link is not None:
                T_number_view = self.pose_in(number)
                return None if T_number_view is None else (link.place, link.T_match_query @ T_number_view)
        return None
