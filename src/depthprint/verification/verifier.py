"""GeometricVerifier: says whether two views are one place, and where the one was seen from the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.projection import LaserRow
from depthprint.verification.agreement import coarse_overlaps, view_agreement
from depthprint.verification.cloud_alignment import CloudAligner
from depthprint.verification.depth_view import DepthView
from depthprint.verification.scan_alignment import ScanAligner
from depthprint.verification.settings import VerificationSettings
from depthprint.verification.starts import (
    kiss_matcher_installed,
    kiss_matcher_start,
    pose_grid,
    yaw_pose,
)

__all__ = ["GeometricVerifier", "Verification", "judged"]

FloatArray = npt.NDArray[np.float64]

_UNKNOWN_YAW_STEPS = 16
# Starts whose matrices differ by less than this everywhere lead to the same pose.
_BESIDE = 0.15
# No other start is tried once the views agree this much.
_CERTAIN = 0.7
# Nor where the best one led to less than this share of the overlap that is needed.
_HOPELESS = 0.5
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


class GeometricVerifier:
    """Align two views and test the pose by what each saw of the other's points.

    A coarse search over ``settings`` offsets about the given yaw proposes starts, small_gicp (point-to-line
    alignment for planar scans) refines the best, and the pose of the largest overlap is judged.
    kiss_matcher: 'fallback' asks it where no start of the search is accepted but one came near, 'never' does not.
    Without the package the search alone serves, and ``starts_from`` says so.
    Raises MissingExtraError, when views in space are compared, without small_gicp. Not safe for several threads.
    """

    def __init__(self, *, kiss_matcher: str = "never") -> None:
        if kiss_matcher not in ("fallback", "never"):
            raise SettingsError(f"GeometricVerifier: expected 'fallback' or 'never', got {kiss_matcher!r}")
        self._kiss = kiss_matcher == "fallback" and kiss_matcher_installed()
        self._wanted_kiss = kiss_matcher == "fallback"
        self._scans = ScanAligner()
        self._clouds: CloudAligner | None = None

    @property
    def starts_from(self) -> str:
        """Where initial poses come from, in words."""
        if self._kiss:
            return "descriptor's alignment and coarse search, then kiss-matcher"
        missing = "; kiss-matcher is not installed" if self._wanted_kiss else ""
        return "descriptor's alignment and coarse search" + missing

    def verify(
        self,
        query: DepthView,
        match: DepthView,
        *,
        yaw_rad: float | None = 0.0,
        starts: Sequence[FloatArray] = (),
        seconded: bool = False,
    ) -> Verification:
        """Check two views. ``yaw_rad``: turn of T_match_query by the descriptor, None for one that is not known.

        ``starts``: further poses T_match_query (4, 4) to refine, such as a neighbouring frame's.
        ``seconded``: a neighbouring frame was found at this place, so that less overlap is enough.
        Raises DataError for views of different kinds of sensors, MissingExtraError.
        """
        _require_one_kind(query, match)
        settings = match.settings
        poses = self._grid(query, yaw_rad)
        if starts:
            poses = np.concatenate([np.stack(starts), poses])
        overlaps = coarse_overlaps(query, match, poses)
        order = _spread_best(poses, overlaps, settings.refined_starts)
        best = int(order[0])
        if overlaps[best] < settings.coarse_overlap:
            return _refused(poses[best], float(overlaps[best]), "no start brings the views to overlap")
        aligner = self._aligner(query)
        found: Verification | None = None
        for start in order:
            pose = aligner.refine(query, match, poses[start])
            origin = "given pose" if start < len(starts) else "coarse search"
            tried = self._judge(query, match, pose, origin, seconded)
            if found is None or _rank(tried) > _rank(found):
                found = tried
            hopeless = _HOPELESS * (settings.min_overlap_seconded if seconded else settings.min_overlap)
            if (found.accepted and found.overlap > _CERTAIN) or found.overlap < hopeless:
                break
        if self._kiss and found is not None and not found.accepted and isinstance(aligner, CloudAligner):
            start_pose = kiss_matcher_start(query, match)
            if start_pose is not None:
                pose = aligner.refine(query, match, start_pose)
                tried = self._judge(query, match, pose, "kiss-matcher", seconded)
                found = max(found, tried, key=_rank)
        if found is None:
            raise DataError("verify: expected at least one start")
        return found

    def refine(self, query: DepthView, match: DepthView, T_match_query: FloatArray) -> Verification:
        """Check two views from one given pose (4, 4), without a search. Raises as ``verify``."""
        _require_one_kind(query, match)
        pose = self._aligner(query).refine(query, match, T_match_query)
        return self._judge(query, match, pose, "given pose", False)

    def _grid(self, query: DepthView, yaw_rad: float | None) -> FloatArray:
        grid = pose_grid(query.settings, query.projection)
        if yaw_rad is None:
            turns = np.linspace(-math.pi, math.pi, _UNKNOWN_YAW_STEPS, endpoint=False)
            return np.concatenate([grid @ yaw_pose(float(turn), query.projection) for turn in turns])
        return grid if yaw_rad == 0.0 else np.asarray(grid @ yaw_pose(yaw_rad, query.projection))

    def _aligner(self, view: DepthView) -> CloudAligner | ScanAligner:
        if isinstance(view.projection, LaserRow):
            return self._scans
        if self._clouds is None:
            self._clouds = CloudAligner()
        return self._clouds

    def _judge(
        self, query: DepthView, match: DepthView, pose: FloatArray, start: str, seconded: bool
    ) -> Verification:
        there = view_agreement(query.counted, match, pose)
        back = view_agreement(match.counted, query, np.asarray(np.linalg.inv(pose), dtype=np.float64))
        inliers, rmse_m = self._aligner(query).residual(query, match, pose)
        overlap = min(there.overlap, back.overlap)
        free = max(there.free_space_share, back.free_space_share)
        agreement = overlap * (1.0 - free)
        if match.settings.noise is not None:
            agreement = max(0.0, 0.5 * (there.likeness + back.likeness))
        pose = np.array(pose, dtype=np.float64)
        pose.setflags(write=False)
        found = Verification(
            T_match_query=pose,
            inliers=inliers,
            overlap=overlap,
            free_space_violations=there.free + back.free,
            free_space_share=free,
            rmse_m=rmse_m,
            accepted=False,
            reason="",
            start=start,
            agreement=agreement,
            reached_elsewhere=match.settings.reached_elsewhere,
            max_offset_m=match.settings.max_offset_m,
            offset_weight=match.settings.offset_weight,
        )
        return judged(found, match.settings, seconded=seconded)


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


def _require_one_kind(query: DepthView, match: DepthView) -> None:
    if isinstance(query.projection, LaserRow) != isinstance(match.projection, LaserRow):
        raise DataError(
            "verify: expected two views of one kind of sensor, got "
            f"{type(query.projection).__name__} and {type(match.projection).__name__}"
        )


def _refused(pose: FloatArray, overlap: float, reason: str) -> Verification:
    pose = np.array(pose, dtype=np.float64)
    pose.setflags(write=False)
    return Verification(pose, 0, overlap, 0, 1.0, math.inf, False, reason, _NO_START)


def _rank(verification: Verification) -> tuple[bool, float]:
    return verification.accepted, verification.agreement


def _spread_best(poses: FloatArray, overlaps: FloatArray, count: int) -> list[int]:
    """The best starts, no two of which lie beside each other."""
    chosen: list[int] = []
    for index in np.argsort(-overlaps, kind="stable")[: 8 * count]:
        apart = [np.abs(poses[index] - poses[other]).max() for other in chosen]
        if all(gap > _BESIDE for gap in apart):
            chosen.append(int(index))
        if len(chosen) == count:
            break
    return chosen
