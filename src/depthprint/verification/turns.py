"""Turns about the sensor's own up: of a pose, and of a step whose alignment may have failed."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.projection import LaserRow, Projection
from depthprint.verification.depth_view import DepthView
from depthprint.verification.verdict import Verification

__all__ = ["Turn", "likeliest", "turn_between", "turn_by_walls", "turn_of"]

# Deviations of a turn by an alignment that is trusted, by walls, by one that is not, and by nothing.
_TRUSTED_RAD, _BY_WALLS_RAD, _DOUBTED_RAD, _UNKNOWN_RAD = np.radians([1.0, 4.0, 8.0, 25.0]).tolist()
# Overlap and agreement under which an alignment says nothing, nor a turn beyond the most of one step.
_LEAST_TOLD, _MOST_TURN_RAD = 0.3, math.radians(75.0)
# Of two alignments that say alike the smaller turn is likelier.
_DOUBT_A_RADIAN = 0.3
# Two walls stand at right angles where the mean of their fourfold directions is as long as this.
_SQUARE = 0.35
_WALL_GAP_M = 0.5


@dataclass(frozen=True)
class Turn:
    """left_rad: radians to the left about the sensor's own up. variance: of it, in radians squared."""

    left_rad: float
    variance: float


def turn_of(T: npt.NDArray[np.float64], projection: Projection) -> float:
    """Radians to the left about the sensor's own up of a pose (4, 4) between frames of a projection."""
    R_flu = projection.R_flu_sensor @ T[:3, :3] @ projection.R_flu_sensor.T
    return math.atan2(R_flu[1, 0], R_flu[0, 0])


def likeliest(tried: Sequence[Verification], projection: Projection) -> Verification:
    """Of the alignments tried of a view and the next one an accepted one, or that which says most."""

    def rank(found: Verification) -> tuple[bool, float]:
        doubt = _DOUBT_A_RADIAN * abs(turn_of(found.T_match_query, projection))
        return found.accepted, _told(found) - doubt

    return max(tried, key=rank)


def turn_between(first: DepthView, second: DepthView, found: Verification, trusted: bool) -> Turn:
    """How far the second view is turned from the first, by the likeliest alignment, whether or not it is ``trusted``.

    Where it is not, planar scans are turned by their walls, to within what it says.
    """
    turn_rad = turn_of(found.T_match_query, second.projection)
    says = _told(found) > _LEAST_TOLD and abs(turn_rad) < _MOST_TURN_RAD
    if says and trusted and found.agreement > 0:
        return Turn(turn_rad, _TRUSTED_RAD**2)
    if not says:
        turn_rad = 0.0
    if isinstance(second.projection, LaserRow):
        by_walls = turn_by_walls(first, second, turn_rad)
        if by_walls is not None:
            return Turn(by_walls, _BY_WALLS_RAD**2)
    return Turn(turn_rad, (_DOUBTED_RAD if says else _UNKNOWN_RAD) ** 2)


def turn_by_walls(first: DepthView, second: DepthView, guess_rad: float) -> float | None:
    """The turn nearest to a guess that brings the walls of two planar scans in line.

    Walls of most buildings meet at right angles: the mean of exp(4 i a) over their directions a tells theirs, up to
    quarter turns. None where that mean is short, or points more than 25 degrees away from the guess.
    """
    walls = [_fourfold(view) for view in (first, second)]
    if min(abs(mean) for mean in walls) < _SQUARE:
        return None
    off = math.remainder((cmath.phase(walls[0]) - cmath.phase(walls[1])) / 4 - guess_rad, math.pi / 2)
    return guess_rad + off if abs(off) < _UNKNOWN_RAD else None


def _told(found: Verification) -> float:
    return found.overlap + found.agreement


def _fourfold(view: DepthView) -> complex:
    from depthprint._kernels.scan_icp import line_normals

    scan = np.ascontiguousarray(view.counted[:, :2], dtype=np.float64)
    normals = np.empty_like(scan)
    line_normals(scan, _WALL_GAP_M, normals)
    return complex(np.mean((normals[:, 0] + 1j * normals[:, 1]) ** 4)) if len(scan) else 0j
