"""Quick alignment of a view with a stored one, by projection into the stored range image as it is."""

from __future__ import annotations

import math
from collections import OrderedDict

import numpy as np
import numpy.typing as npt

from depthprint.verification.depth_view import DepthView
from depthprint.verification.surface import pixels_of, surface_at

__all__ = ["ProjectiveAligner"]

FloatArray = npt.NDArray[np.float64]

# Points of those that are counted, and of all: the ground among these holds height, roll and pitch.
# A hand-held view has no ground to lean on, and is tried on more.
_QUICK, _QUICK_HAND_HELD, _FINE = (250, 125), (400, 200), (1200, 1000)
_SHRINK = 0.75
# Iterations, and the first limit of a pair as a share of the settings': a fine pose starts from a quick one.
_SEARCH, _POLISH = (12, 1.0), (6, 0.3)
_KEPT = 8


class ProjectiveAligner:
    """Point-to-plane ICP whose pairs are found by projection; for views in space.

    ``fine`` takes several times as many points: for the pose of a match, where few tell whether it can be one.
    Source: Blais and Levine, Registering multiview range data to create 3D computer objects, PAMI 1995.
    """

    def __init__(self) -> None:
        self._samples: OrderedDict[tuple[DepthView, bool], tuple[FloatArray, FloatArray]] = OrderedDict()

    def refine(
        self, query: DepthView, match: DepthView, T_match_query: FloatArray, *, fine: bool = False
    ) -> FloatArray:
        """Refine a pose T_match_query (4, 4); one that comes out not finite is given back as it was."""
        from depthprint._kernels.projective_icp import align_by_projection

        poses = np.array(T_match_query[None], dtype=np.float64, order="C")
        iterations, share = _POLISH if fine and not match.settings.whole_clouds else _SEARCH
        align_by_projection(
            *self._sample(query, fine), *_image(match), np.array(match.settings.tolerance),
            share * match.settings.max_pairing_m, _SHRINK, iterations, poses,
        )  # fmt: skip
        return poses[0] if np.isfinite(poses).all() else T_match_query

    def residual(self, query: DepthView, match: DepthView, T_match_query: FloatArray) -> tuple[int, float]:
        """Sampled points of the query that have a partner within pairing distance, and their rms distance, metres."""
        from depthprint._kernels.projective_icp import projective_residual

        pose = np.ascontiguousarray(T_match_query, dtype=np.float64)
        paired, total = projective_residual(
            *self._sample(query, True), *_image(match), match.settings.max_pairing_m, pose
        )
        return int(paired), math.sqrt(total / paired) if paired else math.inf

    def _sample(self, view: DepthView, fine: bool) -> tuple[FloatArray, FloatArray]:
        found = self._samples.pop((view, fine), None)
        if found is None:
            quick = _QUICK_HAND_HELD if view.settings.whole_clouds else _QUICK
            found = _sampled_surface(view, *(_FINE if fine else quick))
            if len(self._samples) >= _KEPT:
                self._samples.popitem(last=False)
        self._samples[view, fine] = found
        return found


def _image(view: DepthView) -> tuple[int, FloatArray, bool, npt.NDArray[np.float32], FloatArray]:
    return *view.camera(), view.ranges_m, view.projection.directions()


def _sampled_surface(view: DepthView, n_counted: int, n_of_all: int) -> tuple[FloatArray, FloatArray]:
    """Points and normals (n, 3) of a view: evenly of those that are counted, and of all."""
    counted = pixels_of(view.counted, view.ranges_m, view.projection)
    seen = np.flatnonzero(np.isfinite(view.ranges_m))
    pixels = np.unique(np.concatenate([_drawn(counted, n_counted), _drawn(seen, n_of_all)]))
    points, normals = surface_at(pixels, view.ranges_m, view.projection)
    known = normals.any(axis=1)
    return points[known], normals[known]


def _drawn(pixels: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.int64]:
    return pixels[np.linspace(0, len(pixels) - 1, min(len(pixels), count)).astype(np.int64)]
