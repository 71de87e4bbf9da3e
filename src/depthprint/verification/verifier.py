"""GeometricVerifier: says whether two views are one place, and where the one was seen from the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.verification.agreement import best_starts, coarse_overlaps, mutual_agreement
from depthprint.verification.cloud_alignment import CloudAligner
from depthprint.verification.depth_view import DepthView
from depthprint.verification.projective_alignment import ProjectiveAligner
from depthprint.verification.scan_alignment import ScanAligner
from depthprint.verification.scan_starts import correlated_starts
from depthprint.verification.settings import VerificationSettings
from depthprint.verification.starts import (
    kiss_matcher_installed,
    kiss_matcher_start,
    pose_grid,
    yaw_pose,
)
from depthprint.verification.verdict import Verification, judged, refused_start

__all__ = ["GeometricVerifier", "Verification", "judged"]

FloatArray = npt.NDArray[np.float64]

_UNKNOWN_YAW_STEPS = 16
# No other start is tried once the views agree this much.
_CERTAIN = 0.7
# Nor where the best one led to less than this share of the overlap that is needed.
_HOPELESS = 0.5
# A pose with less than this share of it is not refined on more points.
_NEAR = 0.8
# Nor one that falls so far short of the agreement of a plausible place, which more points raise by a few hundredths;
# another start may raise it by more. Chosen on a simulated street.
_MOST_GAIN, _MOST_GAIN_OF_STARTS = 0.1, 0.15
# Points that tell how near it came; all that are counted judge a match.
_GLANCED_POINTS = 400


@dataclass(frozen=True, eq=False)
class _Glance:
    """A pose by the quick alignment, with the overlap and the agreement there."""

    pose: FloatArray
    overlap: float
    agreement: float
    given: bool


class GeometricVerifier:
    """Align two views and test the pose by what each saw of the other's points.

    A coarse search about the given yaw, by correlation for planar scans, proposes starts; alignment by projection
    (point to line for planar scans) refines the best few, and the pose of the largest agreement is refined on more
    points, by small_gicp on the whole clouds too where ``settings`` say so, and judged.
    kiss_matcher: 'fallback' asks it where no start of the search is accepted but one came near, 'never' does not.
    Without the package the search alone serves, and ``starts_from`` says so.
    Raises MissingExtraError without small_gicp where ``settings`` ask for whole clouds (hand-held views). Not safe
    for several threads.
    """

    def __init__(self, *, kiss_matcher: str = "never") -> None:
        if kiss_matcher not in ("fallback", "never"):
            raise SettingsError(f"GeometricVerifier: expected 'fallback' or 'never', got {kiss_matcher!r}")
        self._kiss = kiss_matcher == "fallback" and kiss_matcher_installed()
        self._wanted_kiss = kiss_matcher == "fallback"
        self._scans = ScanAligner()
        self._quick = ProjectiveAligner()
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
        if settings.whole_clouds and not match.planar:
            self._whole_clouds()  # what it lacks is said at once, not at the first pair that needs it
        enough = settings.min_overlap_seconded if seconded else settings.min_overlap
        given = [self._glance(query, match, np.asarray(start, dtype=np.float64), True) for start in starts]
        if given and max(glance.overlap for glance in given) >= enough:
            # A pose that is surely right makes a search for one idle.
            found = self._finished(query, match, max(given, key=lambda g: g.agreement), seconded)
            if found.accepted and _certainty(found, match) > _CERTAIN:
                return found
        poses, overlaps = self._starts(query, match, yaw_rad)
        if not given and not (len(poses) and overlaps.max() >= settings.coarse_overlap):
            pose, overlap = (poses[0], float(overlaps.max())) if len(poses) else (np.eye(4), 0.0)
            return refused_start(pose, overlap, "no start brings the views to overlap")
        for start in poses:
            glance = self._glance(query, match, start, False)
            given.append(glance)
            if _certainty(glance, match) > _CERTAIN or glance.overlap < _HOPELESS * enough:
                break
            if all(_falls_short(other, settings, _MOST_GAIN_OF_STARTS) for other in given):
                break
        return self._finished(query, match, max(given, key=lambda g: g.agreement), seconded)

    def refine(self, query: DepthView, match: DepthView, T_match_query: FloatArray) -> Verification:
        """Check two views from one given pose (4, 4), without a search. Raises as ``verify``."""
        _require_one_kind(query, match)
        start = np.asarray(T_match_query, dtype=np.float64)
        return self._finished(query, match, self._glance(query, match, start, True), False)

    def _glance(self, query: DepthView, match: DepthView, start: FloatArray, given: bool) -> _Glance:
        """Where a start leads by the quick alignment, and what the views say of it."""
        pose = self._aligner(query).refine(query, match, start)
        there, back = mutual_agreement(query, match, pose, _GLANCED_POINTS)
        agreement = 0.5 * (there.likeness + back.likeness)
        return _Glance(pose, min(there.overlap, back.overlap), agreement, given)

    def _finished(self, query: DepthView, match: DepthView, glance: _Glance, seconded: bool) -> Verification:
        """Judge the best pose of the search; one that came near is refined on more points first."""
        origin = "given pose" if glance.given else "coarse search"
        if query.planar:
            return self._judge(query, match, glance.pose, origin, seconded)
        settings = match.settings
        enough = settings.min_overlap_seconded
        if glance.overlap < _NEAR * enough:
            reason = f"{glance.overlap:.0%} of the views agree, {enough:.0%} are needed"
            found = refused_start(glance.pose, glance.overlap, reason)
        elif not glance.given and _falls_short(glance, settings, _MOST_GAIN):
            least = settings.min_agreement_seconded
            reason = f"the views agree to {glance.agreement:.2f} within their noise, {least:.2f} is needed"
            found = refused_start(glance.pose, glance.overlap, reason)
        else:
            found = self._refined(query, match, glance.pose, origin, seconded, settings.whole_clouds)
        if self._kiss and not found.accepted:
            start = kiss_matcher_start(query, match)
            if start is not None:
                pose = self._whole_clouds().refine(query, match, start)
                found = max(
                    found, self._refined(query, match, pose, "kiss-matcher", seconded, False), key=_rank
                )
        return found

    def _refined(
        self,
        query: DepthView,
        match: DepthView,
        pose: FloatArray,
        origin: str,
        seconded: bool,
        whole_clouds: bool,
    ) -> Verification:
        """The verdict on a pose once it is refined on many points, and if refused on the whole clouds first."""
        fine = self._quick.refine(query, match, pose, fine=True)
        found = self._judge(query, match, fine, origin, seconded)
        if found.accepted or not whole_clouds:
            return found
        whole = self._whole_clouds().refine(query, match, fine)
        fine = self._quick.refine(query, match, whole, fine=True)
        return max(found, self._judge(query, match, fine, origin, seconded), key=_rank)

    def _starts(
        self, query: DepthView, match: DepthView, yaw_rad: float | None
    ) -> tuple[FloatArray, FloatArray]:
        """Poses (k, 4, 4) to align from, the best first, and their overlaps (k,)."""
        if query.planar:
            poses = correlated_starts(query, match, yaw_rad)
            return poses, coarse_overlaps(query, match, poses)
        grid = self._grid(query, yaw_rad)
        order, overlaps = best_starts(query, match, grid, match.settings.refined_starts)
        return grid[order], overlaps[order]

    def _grid(self, query: DepthView, yaw_rad: float | None) -> FloatArray:
        grid = pose_grid(query.settings, query.projection)
        if yaw_rad is None:
            turns = np.linspace(-math.pi, math.pi, _UNKNOWN_YAW_STEPS, endpoint=False)
            return np.concatenate([grid @ yaw_pose(float(turn), query.projection) for turn in turns])
        return grid if yaw_rad == 0.0 else np.asarray(grid @ yaw_pose(yaw_rad, query.projection))

    def _aligner(self, view: DepthView) -> ProjectiveAligner | ScanAligner:
        return self._scans if view.planar else self._quick

    def _whole_clouds(self) -> CloudAligner:
        if self._clouds is None:
            self._clouds = CloudAligner()
        return self._clouds

    def _judge(
        self, query: DepthView, match: DepthView, pose: FloatArray, start: str, seconded: bool
    ) -> Verification:
        there, back = mutual_agreement(query, match, pose)
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


def _certainty(found: _Glance | Verification, match: DepthView) -> float:
    """How much views agree, of which the walls of a corridor in a planar scan say little."""
    return found.agreement if match.planar else found.overlap


def _falls_short(glance: _Glance, settings: VerificationSettings, gain: float) -> bool:
    """Whether a pose could gain so much in agreement and still be of no plausible place, where the noise is known."""
    return settings.noise is not None and glance.agreement + gain < settings.min_agreement_seconded


def _require_one_kind(query: DepthView, match: DepthView) -> None:
    if query.planar != match.planar:
        raise DataError(
            "verify: expected two views of one kind of sensor, got "
            f"{type(query.projection).__name__} and {type(match.projection).__name__}"
        )


def _rank(verification: Verification) -> tuple[bool, float]:
    return verification.accepted, verification.agreement
