"""Quick alignment of a view with a stored one, by projection into the stored range image as it is."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from depthprint.verification.depth_view import DepthView
from depthprint.verification.view_surface import surface_of

__all__ = ["ProjectiveAligner"]

FloatArray = npt.NDArray[np.float64]

_SHRINK = 0.75
# Iterations, and the first limit of a pair as a share of the settings': a fine pose starts from a quick one.
_SEARCH, _POLISH = (12, 1.0), (6, 0.3)


class ProjectiveAligner:
    """Point-to-plane ICP whose pairs are found by projection; for views in space.

    ``fine`` takes several times as many points: for the pose of a match, where few tell whether it can be one.
    Source: Blais and Levine, Registering multiview range data to create 3D computer objects, PAMI 1995.
    """

    def refine(
        self, query: DepthView, match: DepthView, T_match_query: FloatArray, *, fine: bool = False
    ) -> FloatArray:
        """Refine a pose T_match_query (4, 4); one that comes out not finite is given back as it was."""
        from depthprint._kernels.projective_icp import align_by_projection

        pose = np.array(T_match_query, dtype=np.float64, order="C")
        settings = match.settings
        iterations, share = _POLISH if fine and not settings.whole_clouds else _SEARCH
        align_by_projection(
            *_sample(query, fine), match.image, share * settings.max_pairing_m, _SHRINK, iterations, pose
        )
        return pose if np.isfinite(pose).all() else T_match_query

    def residual(self, query: DepthView, match: DepthView, T_match_query: FloatArray) -> tuple[int, float]:
        """Sampled points of the query that have a partner within pairing distance, and their rms distance, metres."""
        from depthprint._kernels.projective_icp import projective_residual

        pose = np.ascontiguousarray(T_match_query, dtype=np.float64)
        paired, total = projective_residual(
            *_sample(query, True), match.image, match.settings.max_pairing_m, pose
        )
        return int(paired), math.sqrt(total / paired) if paired else math.inf


def _sample(view: DepthView, fine: bool) -> tuple[FloatArray, FloatArray]:
    surface = surface_of(view)
    return surface.fine if fine else surface.quick
