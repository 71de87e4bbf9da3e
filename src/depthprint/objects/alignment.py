"""Alignment of a query's surface with stored views that a recogniser proposes: how far both depth images agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from depthprint.range_image import RangeImage
from depthprint.turned_views import turn_of_points

if TYPE_CHECKING:
    from depthprint._kernels.surface_alignment import SeenSurface

__all__ = [
    "AGREEMENT_WEIGHT",
    "CHECKED_CLASSES",
    "CHECKED_VIEWS",
    "SurfaceAlignment",
    "align_object_views",
    "aligned_agreements",
    "checked_scores",
    "proposed_views",
    "with_agreement",
]

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

# Chosen on views of training objects: see docs/experiments.md.
STARTS_DEG = ((-30.0, 0.0), (-15.0, 0.0), (0.0, 0.0), (15.0, 0.0), (30.0, 0.0))
CHECKED_CLASSES = 10
CHECKED_VIEWS = 3
AGREEMENT_WEIGHT = 2.2

_COARSE = (4, 6)
_FINE = 5
# Of depth, metres at one metre and growing with its square; and share of the stored surface's size.
_DEPTH_NOISE = 0.003
_SHAPE_NOISE = 0.02
# Of what an agreement is worth, which is 1 at that of two good views of one object.
_STEEPNESS = 12.0
_GOOD_AGREEMENT = 0.8


@dataclass(frozen=True)
class SurfaceAlignment:
    """How a query lies on a stored view, and how far they agree.

    T_stored_query: (4, 4) float64, read-only, from the query's camera frame to the stored one's. agreement: 1 where
    each confirms all of the other, below 0 where they see through more of each other than they confirm.
    """

    T_stored_query: FloatArray
    agreement: float

    def __post_init__(self) -> None:
        self.T_stored_query.setflags(write=False)


def align_object_views(query: RangeImage, stored: RangeImage) -> SurfaceAlignment:
    """Align two pinhole crops of objects, metric and rigid, from a few turns up and down about the object's middle.

    Point-to-plane by projection. What of the object the query does not show does not count; the stored view is taken
    to show all that its camera could see. Raises DataError as ``object_surface`` does.
    """
    from depthprint.object_surface import object_surface

    asked = object_surface(query)
    pose, agreement = _aligned(asked, object_surface(stored))
    moved = pose.copy()
    moved[:3, 3] -= pose[:3, :3] @ asked.middle
    return SurfaceAlignment(moved, agreement)


def aligned_agreements(query: SeenSurface, stored: Sequence[SeenSurface]) -> FloatArray:
    """Agreement (n,) of a query with each of the stored surfaces."""
    from depthprint._kernels.tasks import run_tasks

    agreements = np.empty(len(stored))

    def align(number: int) -> None:
        agreements[number] = _aligned(query, stored[number])[1]

    run_tasks([partial(align, number) for number in range(len(stored))])
    return agreements


def checked_scores(
    scores: FloatArray,
    labels: npt.NDArray[Any],
    view_labels: npt.NDArray[Any],
    likeness: npt.NDArray[Any],
    agreements_with: Callable[[int, IndexArray], FloatArray],
    weight: float,
) -> FloatArray:
    """Scores (m, c) of queries with what their alignment with the views that they propose says, as ``with_agreement``.

    labels (c,) of the classes; view_labels (n,) of the stored views, likeness (m, n) to them. agreements_with: of a
    query's number and those of some stored views, how far it agrees with each.
    """
    rows = []
    for query, proposed in enumerate(scores):
        views = proposed_views(proposed, labels, view_labels, likeness[query])
        agreements = agreements_with(query, views)
        rows.append(with_agreement(proposed, labels, view_labels[views], agreements, weight))
    return np.stack(rows)


def proposed_views(
    scores: FloatArray, labels: npt.NDArray[Any], view_labels: npt.NDArray[Any], likeness: npt.NDArray[Any]
) -> IndexArray:
    """Numbers of the stored views to align: the likest few of each of the best classes.

    scores (c,) of the classes ``labels`` (c,); view_labels (n,) and likeness (n,) of the stored views.
    """
    best = labels[np.argsort(-scores, kind="stable")[:CHECKED_CLASSES]]
    members = [np.flatnonzero(view_labels == label) for label in best]
    chosen = [of[np.argsort(-likeness[of], kind="stable")[:CHECKED_VIEWS]] for of in members]
    return np.asarray(np.concatenate(chosen), dtype=np.int64)


def with_agreement(
    scores: FloatArray,
    labels: npt.NDArray[Any],
    proposed_labels: npt.NDArray[Any],
    agreements: FloatArray,
    weight: float,
) -> FloatArray:
    """Scores (c,), brought to deviation 1, and ``weight`` times what the best agreement of each class is worth.

    That grows as exp(12 agreement) and is 1 at an agreement of 0.8, so that a view of the same object counts and the
    less unlike of two others hardly does.
    Classes of which no view was aligned get what the worst of the others has.
    """
    from depthprint.objects.fused_recogniser import standardised

    worth = np.full(len(labels), np.inf)
    for label in np.unique(proposed_labels):
        best = agreements[proposed_labels == label].max()
        worth[labels == label] = math.exp(_STEEPNESS * (best - _GOOD_AGREEMENT))
    worth[~np.isfinite(worth)] = worth.min()
    return np.asarray(standardised(scores[None])[0] + weight * worth)


def _aligned(query: SeenSurface, stored: SeenSurface) -> tuple[FloatArray, float]:
    from depthprint._kernels.surface_alignment import align_surfaces

    pose = np.eye(4)
    noise = _DEPTH_NOISE * float(stored.middle[2]) ** 2 + _SHAPE_NOISE * stored.size
    return pose, float(align_surfaces(query, stored, _starts(), _COARSE, _FINE, noise, pose))


@lru_cache(maxsize=1)
def _starts() -> FloatArray:
    starts = np.stack([turn_of_points(up, right) for up, right in STARTS_DEG])
    starts.setflags(write=False)
    return starts
