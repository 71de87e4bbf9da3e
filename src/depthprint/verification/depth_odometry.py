"""DepthOdometry: motion from frame to frame by aligning each view with the one before."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.verification.depth_view import DepthView
from depthprint.verification.verifier import GeometricVerifier, Verification

__all__ = ["DepthOdometry"]

FloatArray = npt.NDArray[np.float64]


class DepthOdometry:
    """Poses of views added one after the other, in chains: a view that does not agree with the last starts a new one.

    Within a chain they drift as any odometry does.
    """

    def __init__(self, verifier: GeometricVerifier) -> None:
        self._verifier = verifier
        self._last: DepthView | None = None
        self._motion = np.eye(4)
        self._step: tuple[DepthView, FloatArray | None] | None = None
        self._poses: list[FloatArray] = []
        self._inverses: list[FloatArray] = []
        self._chains: list[int] = []

    def __len__(self) -> int:
        return len(self._poses)

    def add(self, view: DepthView) -> None:
        """Append a view; its number is the count of those before."""
        step = self._step_to(view)
        if step is None or not self._poses:
            self._poses.append(np.eye(4))
            self._chains.append(self._chains[-1] + 1 if self._chains else 0)
            self._motion = np.eye(4)
        else:
            self._poses.append(self._poses[-1] @ step)
            self._chains.append(self._chains[-1])
            self._motion = step
        self._inverses.append(np.asarray(np.linalg.inv(self._poses[-1]), dtype=np.float64))
        self._last = view

    def pose_of_next(self, first: int, view: DepthView) -> FloatArray | None:
        """T_first_view (4, 4) of a view that follows the last one added; None where the chain from ``first`` broke."""
        if not self._chains or self._chains[first] != self._chains[-1]:
            return None
        step = self._step_to(view)
        return None if step is None else self._inverses[first] @ self._poses[-1] @ step

    def relative_poses(self, second: int, below: int) -> tuple[npt.NDArray[np.int64], FloatArray]:
        """Numbers (n,) under ``below`` of the views of one chain with ``second``, and T_number_second (n, 4, 4)."""
        numbers = np.flatnonzero(np.array(self._chains[:below]) == self._chains[second])
        if not len(numbers):
            return numbers, np.empty((0, 4, 4))
        inverses = np.stack([self._inverses[number] for number in numbers])
        return numbers, np.asarray(inverses @ self._poses[second])

    def relative_pose(self, first: int, second: int) -> FloatArray | None:
        """T_first_second (4, 4) of two views, or None where the chain between them broke."""
        if self._chains[first] != self._chains[second]:
            return None
        return np.asarray(np.linalg.inv(self._poses[first]) @ self._poses[second])

    def _step_to(self, view: DepthView) -> FloatArray | None:
        """T_last_view, or None where the two do not agree."""
        if self._last is None:
            return None
        if self._step is None or self._step[0] is not view:
            found = self._verifier.refine(view, self._last, self._motion)
            if not found.accepted:
                found = self._verifier.verify(view, self._last, starts=(self._motion,))
            self._step = view, found.T_match_query if _trusted(found, view) else None
        return self._step[1]


def _trusted(found: Verification, view: DepthView) -> bool:
    return found.accepted or (
        found.overlap >= view.settings.min_overlap_motion and found.inliers >= view.settings.min_points
    )
