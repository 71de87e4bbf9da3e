"""Overlap and free-space consistency of two views under a pose: one is projected into the other, both ways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.verification.depth_view import DepthView

__all__ = ["ViewAgreement", "coarse_overlaps", "thinned", "view_agreement"]

# All poses are tried on a few points, those that did best on more.
_FIRST_POINTS, _COARSE_POINTS = 32, 128
_BEST_SHARE = 0.2
_COARSE_SLACK = 2.0


@dataclass(frozen=True)
class ViewAgreement:
    """Points of one view in another: ``confirmed`` by its ranges, ``hidden`` behind them, in space seen to be
    ``free``, and ``unseen`` (outside the image, or where it has no return).

    likeness: weighted mean over the points of how well each is confirmed, in 0..1 by the sensor's noise; one
    well inside free space counts -1.
    """

    confirmed: int
    hidden: int
    free: int
    unseen: int
    likeness: float = 0.0

    @property
    def overlap(self) -> float:
        """Share of all points that is confirmed; 0 without points."""
        total = self.confirmed + self.hidden + self.free + self.unseen
        return self.confirmed / total if total else 0.0

    @property
    def free_space_share(self) -> float:
        """Share in free space of the points that are there or in free space; 1 where none is."""
        known = self.confirmed + self.free
        return self.free / known if known else 1.0


def view_agreement(
    points: npt.NDArray[np.float32],
    view: DepthView,
    T_view_points: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float32] | None = None,
) -> ViewAgreement:
    """Count what a view says of points (n, 3) float32 brought to its frame by T_view_points (4, 4).

    weights (n,) float32: what each point counts in ``likeness``; all alike when None. A pixel and its eight
    neighbours are asked, within the tolerance of the view's sensor. Raises DataError for other shapes or a pose
    that is not finite.
    """
    pose = np.asarray(T_view_points, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise DataError(f"view_agreement: expected a finite pose (4, 4), got shape {pose.shape}")
    if points.ndim != 2 or points.shape[1] != 3:
        raise DataError(f"view_agreement: expected points (n, 3), got {points.shape}")
    if weights is None:
        weights = np.ones(len(points), dtype=np.float32)
    if weights.shape != (len(points),):
        raise DataError(f"view_agreement: expected weights ({len(points)},), got {weights.shape}")
    counts, likeness = _counts(points, weights, view, pose[None], 1, 1.0)
    confirmed, hidden, free, unseen = (int(count) for count in counts[0])
    return ViewAgreement(confirmed, hidden, free, unseen, float(likeness[0]))


def coarse_overlaps(
    query: DepthView, match: DepthView, T_match_query: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Share of a few of the query's points that the match confirms, for poses (m, 4, 4).

    Poses that do badly on fewer points yet are not looked at again.
    """
    overlaps = _confirmed(query, match, T_match_query, _FIRST_POINTS)
    best = np.argsort(-overlaps, kind="stable")[: max(8, round(_BEST_SHARE * len(overlaps)))]
    overlaps[best] = _confirmed(query, match, T_match_query[best], _COARSE_POINTS)
    return overlaps


def _confirmed(
    query: DepthView, match: DepthView, T_match_query: npt.NDArray[np.float64], n_points: int
) -> npt.NDArray[np.float64]:
    points = thinned(query.counted, n_points)
    weights = np.ones(len(points), dtype=np.float32)
    counts, _ = _counts(points, weights, match, T_match_query, 0, _COARSE_SLACK)
    return np.asarray(counts[:, 0] / max(1, len(points)))


def thinned(points: npt.NDArray[np.float32], count: int) -> npt.NDArray[np.float32]:
    """About ``count`` of some points (n, 3), or of their weights (n,), evenly drawn."""
    return points[:: max(1, len(points) // count)]


def _counts(
    points: npt.NDArray[np.float32],
    weights: npt.NDArray[np.float32],
    view: DepthView,
    poses: npt.NDArray[np.float64],
    neighbours: int,
    slack: float,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    from depthprint._kernels.agreement import count_agreement

    kind, camera, wraps = view.camera()
    counts = np.zeros((len(poses), 4), dtype=np.int64)
    likeness = np.zeros(len(poses))
    count_agreement(
        np.ascontiguousarray(points, dtype=np.float32),
        np.ascontiguousarray(weights, dtype=np.float32),
        np.ascontiguousarray(poses, dtype=np.float64),
        kind,
        camera,
        wraps,
        view.ranges_m,
        slack * np.array(view.settings.tolerance),
        np.array(view.settings.noise or view.settings.tolerance),
        neighbours,
        counts,
        likeness,
    )
    return counts, likeness
