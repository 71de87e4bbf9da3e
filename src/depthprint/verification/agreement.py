"""Overlap and free-space consistency of two views under a pose: one is projected into the other, both ways."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.rigid_motion import inverse_pose
from depthprint.verification.depth_view import DepthView, read_only

__all__ = ["ViewAgreement", "best_starts", "coarse_overlaps", "mutual_agreement", "view_agreement"]

# All poses are tried on a few points, those that did best on more.
_FIRST_POINTS, _COARSE_POINTS = 32, 128
_BEST_SHARE = 0.2
_COARSE_SLACK = 2.0
# Starts whose matrices differ by less than this everywhere lead to the same pose.
_BESIDE = 0.15


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
    points, weights = read_only(points, np.float32), read_only(weights, np.float32)
    return _counted(points, weights, 1, view, np.ascontiguousarray(pose))


def mutual_agreement(
    query: DepthView, match: DepthView, T_match_query: npt.NDArray[np.float64], count: int | None = None
) -> tuple[ViewAgreement, ViewAgreement]:
    """What the match says of the query's counted points under a pose (4, 4), and the query of the match's.

    ``count``: about so many of them are asked, evenly drawn; all when None. The points' weights count where the noise
    of the view that is asked is known.
    """
    pose = np.ascontiguousarray(T_match_query, dtype=np.float64)
    return _seen(query, match, pose, count), _seen(match, query, inverse_pose(pose), count)


def _seen(
    view: DepthView, by: DepthView, T_by_view: npt.NDArray[np.float64], count: int | None
) -> ViewAgreement:
    points = view.counted_by_kernels
    weights = view.weights if by.settings.noise is not None else _alike(len(points))
    return _counted(points, weights, _step(len(points), count), by, T_by_view)


def coarse_overlaps(
    query: DepthView, match: DepthView, T_match_query: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Share of a few of the query's points that the match confirms, for poses (m, 4, 4).

    Poses that do badly on fewer points yet are not looked at again.
    """
    from depthprint._kernels.start_search import confirmed_shares

    shares = np.empty(len(T_match_query))
    confirmed_shares(
        query.counted_by_kernels, _FIRST_POINTS, _COARSE_POINTS, max(8, round(_BEST_SHARE * len(shares))),
        _COARSE_SLACK, read_only(T_match_query, np.float64), match.image, shares,
    )  # fmt: skip
    return shares


def best_starts(
    query: DepthView, match: DepthView, T_match_query: npt.NDArray[np.float64], count: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Which up to ``count`` of poses (m, 4, 4) lead to the largest `coarse_overlaps`, best first; all their overlaps.

    No two of them lie beside each other.
    """
    from depthprint._kernels.start_search import spread_best

    overlaps = coarse_overlaps(query, match, T_match_query)
    return spread_best(read_only(T_match_query, np.float64), overlaps, count, _BESIDE), overlaps


def _step(total: int, count: int | None) -> int:
    """Every how many of some points are to be drawn for about ``count`` of them."""
    return 1 if count is None else max(1, total // count)


@lru_cache(maxsize=16)
def _alike(count: int) -> npt.NDArray[np.float32]:
    """Weights of points that all count the same."""
    return read_only(np.ones(count), np.float32)


def _counted(
    points: npt.NDArray[np.float32],
    weights: npt.NDArray[np.float32],
    step: int,
    view: DepthView,
    pose: npt.NDArray[np.float64],
) -> ViewAgreement:
    from depthprint._kernels.agreement import count_agreement

    counts = np.empty(4, dtype=np.int64)
    likeness = count_agreement(points, weights, step, pose, view.image, counts)
    confirmed, hidden, free, unseen = counts.tolist()
    return ViewAgreement(confirmed, hidden, free, unseen, likeness)
