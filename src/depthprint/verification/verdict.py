"""Verification: what one geometric check found, and the rule by which it is accepted or refused."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from depthprint.verification.settings import VerificationSettings

__all__ = ["Verification", "judged", "refused_start"]

FloatArray = npt.NDArray[np.float64]

_NO_START = "none"


@dataclass(frozen=True, eq=False)
class Verification:
    """Outcome of one check.

    T_match_query: (4, 4) float64, read-only: brings the query's points to the match's sensor frame.
    inliers: the query's points that have a partner, and rmse_m of their distances. overlap: share of a view
    that the other confirms, the smaller of both ways. free_space_violations: points of either that lie where the
    other saw through, and free_space_share of them among those and the confirmed, the larger of both ways.
    agreement: in [0, 1], mean of both ways of ``ViewAgreement.likeness`` where the noise is known, else
        overlap * (1 - free_space_share); wrong places of one shape often reach
        ``reached_elsewhere``.
    accepted, and the reason for it in words. start: where the pose started from. max_offset_m: the longest allowed.
    """

    T_match_query: FloatArray
    inliers: int
    overlap: float
    free_space_violations: int
    free_space_share: float
    rmse_m: float
    accepted: bool
    reason: str
    start: str
    agreement: float = 0.0
    reached_elsewhere: float = 0.0
    max_offset_m: float = math.inf
    offset_weight: float = 0.5

    @property
    def nearness(self) -> float:
        """Agreement, less for views seen from further apart: what the best of several accepted places has most of."""
        return self.agreement * (1.0 - self.offset_weight * min(1.0, self.offset_m / self.max_offset_m))

    @property
    def offset_m(self) -> float:
        """Distance between the two sensors."""
        return float(np.linalg.norm(self.T_match_query[:3, 3]))


def judged(found: Verification, settings: VerificationSettings, *, seconded: bool) -> Verification:
    """The same alignment, accepted or refused by the rule for seconded places or by that for lone ones."""
    if found.start == _NO_START:
        return found
    reason = _refusal(found, settings, seconded)
    approval = f"{found.overlap:.0%} of the views agree, {found.free_space_share:.0%} are seen through"
    return replace(found, accepted=not reason, reason=reason or approval)


def _refusal(found: Verification, settings: VerificationSettings, seconded: bool) -> str:
    """Why an alignment is refused; empty when it is not."""
    enough = settings.min_overlap_seconded if seconded else settings.min_overlap
    most_free = settings.max_free_space_share_seconded if seconded else settings.max_free_space_share
    least = settings.min_agreement_seconded if seconded else settings.min_agreement
    if found.inliers < settings.min_points:
        return f"{found.inliers} points have a partner, {settings.min_points} are needed"
    if found.offset_m > settings.max_offset_m:
        return f"the views would be {found.offset_m:.1f} m apart, more than {settings.max_offset_m:g} m"
    if found.overlap < enough:
        return f"{found.overlap:.0%} of the views agree, {enough:.0%} are needed"
    if found.free_space_share > most_free:
        return f"{found.free_space_share:.0%} lie where the other view sees through, {most_free:.0%} may"
    if found.agreement < least:
        return f"the views agree to {found.agreement:.2f} within their noise, {least:.2f} is needed"
    return ""


def refused_start(pose: FloatArray, overlap: float, reason: str) -> Verification:
    """The outcome of a check that came to no alignment to judge: the pose (4, 4) it stopped at."""
    pose = np.array(pose, dtype=np.float64)
    pose.setflags(write=False)
    return Verification(pose, 0, overlap, 0, 1.0, math.inf, False, reason, _NO_START)
