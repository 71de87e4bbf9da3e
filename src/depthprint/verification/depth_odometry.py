"""DepthOdometry: motion from frame to frame by aligning each view with the one before."""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.rigid_motion import inverse_pose
from depthprint.verification.depth_view import DepthView
from depthprint.verification.turns import Turn, likeliest, turn_between
from depthprint.verification.verifier import GeometricVerifier, Verification

__all__ = ["DepthOdometry"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Step:
    """From the last view to a view that follows: T_last_view, None where the two do not agree, and the turn even so."""

    view: DepthView
    pose: FloatArray | None
    turn: Turn


class DepthOdometry:
    """Poses of views added one after the other, in chains: a view that does not agree with the last starts a new one.

    Within a chain they drift as any odometry does.
    """

    def __init__(self, verifier: GeometricVerifier) -> None:
        self._verifier = verifier
        self._last: DepthView | None = None
        self._motion = np.eye(4)
        self._step: _Step | None = None
        self._poses: list[FloatArray] = []
        self._inverses: list[FloatArray] = []
        self._chains: list[int] = []
        self._positions_m = array("d")

    def __len__(self) -> int:
        return len(self._poses)

    def add(self, view: DepthView) -> None:
        """Append a view; its number is the count of those before."""
        step = self._pose_from_last(view)
        if step is None or not self._poses:
            self._poses.append(np.eye(4))
            self._chains.append(self._chains[-1] + 1 if self._chains else 0)
            self._motion = np.eye(4)
        else:
            self._poses.append(self._poses[-1] @ step)
            self._chains.append(self._chains[-1])
            self._motion = step
        self._inverses.append(inverse_pose(self._poses[-1]))
        self._positions_m.extend(self._poses[-1][:3, 3])
        self._last = view

    def pose_of_next(self, first: int, view: DepthView) -> FloatArray | None:
        """T_first_view (4, 4) of a view that follows the last one added; None where the chain from ``first`` broke."""
        if not self._chains or self._chains[first] != self._chains[-1]:
            return None
        step = self._pose_from_last(view)
        return None if step is None else self._inverses[first] @ self._poses[-1] @ step

    def turn_to(self, view: DepthView) -> Turn:
        """Turn from the last view added to one that follows: a guess where the two do not agree."""
        step = self._step_to(view)
        return Turn(0.0, 0.0) if step is None else step.turn

    def places_near(
        self, second: int, T_second_view: FloatArray, below: int, reach_m: float
    ) -> tuple[npt.NDArray[np.int64], FloatArray]:
        """Views of the chain of ``second`` within reach of a pose in it: their numbers under ``below``, (n,).

        And T_number_view (n, 4, 4) of that pose.
        """
        T_chain_view = self._poses[second] @ T_second_view
        chain = self._chains[second]
        first, end = bisect_left(self._chains, chain), min(below, bisect_right(self._chains, chain))
        positions_m = np.array(self._positions_m[3 * first : 3 * max(first, end)]).reshape(-1, 3)
        apart_m = np.linalg.norm(positions_m - T_chain_view[:3, 3], axis=1)
        numbers = first + np.flatnonzero(apart_m < reach_m)
        if not len(numbers):
            return numbers, np.empty((0, 4, 4))
        inverses = np.stack([self._inverses[number] for number in numbers])
        return numbers, np.asarray(inverses @ T_chain_view)

    def relative_pose(self, first: int, second: int) -> FloatArray | None:
        """T_first_second (4, 4) of two views, or None where the chain between them broke."""
        if self._chains[first] != self._chains[second]:
            return None
        return np.asarray(self._inverses[first] @ self._poses[second])

    def _pose_from_last(self, view: DepthView) -> FloatArray | None:
        step = self._step_to(view)
        return None if step is None else step.pose

    def _step_to(self, view: DepthView) -> _Step | None:
        """The step from the last view, or None where there is none."""
        if self._last is None:
            return None
        if self._step is None or self._step.view is not view:
            tried: list[Verification] = []
            if not view.planar:
                # One row alone may agree with the last wherever along its walls.
                tried.append(self._verifier.refine(view, self._last, self._motion))
            for yaw_rad in view.settings.motion_yaw_rad:
                if tried and tried[-1].accepted:
                    break
                tried.append(self._verifier.verify(view, self._last, yaw_rad=yaw_rad, starts=(self._motion,)))
            found = likeliest(tried, view.projection)
            trusted = _trusted(found, view)
            turn = turn_between(self._last, view, found, trusted)
            self._step = _Step(view, found.T_match_query if trusted else None, turn)
        return self._step


def _trusted(found: Verification, view: DepthView) -> bool:
    return found.accepted or (
        found.overlap >= view.settings.min_overlap_motion and found.inliers >= view.settings.min_points
    )
