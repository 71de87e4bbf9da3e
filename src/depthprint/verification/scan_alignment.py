"""Alignment of two planar scans, point to line."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from depthprint.projection import LaserRow
from depthprint.verification.depth_view import DepthView

__all__ = ["ScanAligner", "spatial_pose"]

FloatArray = npt.NDArray[np.float64]

_ITERATIONS = 20
_BEAMS_APART = 1.5


class ScanAligner:
    """Point-to-line ICP of planar scans; poses stay in the plane.

    Source: Censi, An ICP variant using a point-to-line metric, ICRA 2008, with Gauss-Newton steps.
    """

    def refine(self, query: DepthView, match: DepthView, T_match_query: FloatArray) -> FloatArray:
        """Refine a pose T_match_query (4, 4), of which x, y and yaw count."""
        from depthprint._kernels.scan_icp import align_scans, line_normals

        target = _planar(match)
        normals = np.empty_like(target)
        line_normals(target, 0.5, normals)
        pose = _planar_pose(T_match_query)
        align_scans(
            _planar(query), target, normals, pose, match.settings.max_pairing_m, _spacing(match), _ITERATIONS
        )
        return spatial_pose(pose) if np.isfinite(pose).all() else T_match_query

    def residual(self, query: DepthView, match: DepthView, T_match_query: FloatArray) -> tuple[int, float]:
        """Points of the query that have a neighbour within pairing distance, and their rms distance, metres."""
        from depthprint._kernels.scan_icp import scan_residual

        limit = match.settings.max_pairing_m
        paired, total = scan_residual(
            _planar(query), _planar(match), _planar_pose(T_match_query), limit, _spacing(match)
        )
        return int(paired), math.sqrt(total / paired) if paired else math.inf


def _spacing(view: DepthView) -> float:
    """How much further apart partners may be a metre of range: beams part, and walls are met aslant."""
    step_rad = view.projection.angle_step_rad if isinstance(view.projection, LaserRow) else 0.0
    return _BEAMS_APART * abs(step_rad)


def _planar(view: DepthView) -> FloatArray:
    return np.ascontiguousarray(view.points[:, :2], dtype=np.float64)


def _planar_pose(T: FloatArray) -> FloatArray:
    return np.array([T[0, 3], T[1, 3], math.atan2(T[1, 0], T[0, 0])])


def spatial_pose(pose: FloatArray) -> FloatArray:
    """The pose (4, 4) of x, y and yaw (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    T = np.eye(4)
    T[:2, :2] = (c, -s), (s, c)
    T[:2, 3] = pose[:2]
    return T
