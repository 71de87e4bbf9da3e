"""Turns about the sensor's own up: of a pose, and of a step whose alignment may have failed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.projection import Projection
from depthprint.verification.depth_view import DepthView
from depthprint.verification.verdict import Verification

__all__ = ["Turn", "likeliest", "turn_between", "turn_by_walls", "turn_of"]

# Deviations of a turn by an alignment that is trusted, by walls, by one that is not, and by nothing.
_TRUSTED_RAD, _BY_WALLS_RAD, _DOUBTED_RAD, _UNKNOWN_RAD = np.radians([1.0, 8.0, 8.0, 25.0]).tolist()
# Overlap and agreement under which an alignment says nothing, nor a turn beyond the most of one step.
_LEAST_TOLD, _MOST_TURN_RAD = 0.3, math.radians(75.0)
# Of two alignments that say alike the smaller turn is likelier.
_DOUBT_A_RADIAN = 0.3
# Histograms of walls: one bin a degree, smoothed over three; neighbours further apart are of no one wall.
_BEARINGS, _WALL_GAP_M = 360, 0.5
_SHIFTS_RAD = np.radians((np.arange(_BEARINGS) + 180) % 360 - 180)
_SMOOTHING = np.exp(-0.5 * (3.0 * math.tau / _BEARINGS * np.arange(_BEARINGS // 2 + 1)) ** 2)
# Least cosine of two that are alike, the most that a step turns, and how much a turn must gain.
_LEAST_ALIKE, _MOST_BY_WALLS_RAD = 0.7, math.radians(45.0)
_DOUBTED_SHIFTS = 0.12 * np.abs(_SHIFTS_RAD)


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

    Where it is not, planar scans are turned by their walls.
    """
    turn_rad = turn_of(found.T_match_query, second.projection)
    says = _told(found) > _LEAST_TOLD and abs(turn_rad) < _MOST_TURN_RAD
    if says and trusted and found.agreement > 0:
        return Turn(turn_rad, _TRUSTED_RAD**2)
    by_walls = turn_by_walls(first, second) if second.planar else None
    if by_walls is not None:
        return Turn(by_walls, _BY_WALLS_RAD**2)
    return Turn(turn_rad, _DOUBTED_RAD**2) if says else Turn(0.0, _UNKNOWN_RAD**2)


def turn_by_walls(first: DepthView, second: DepthView) -> float | None:
    """The turn in radians that brings the walls of two planar scans in line, wherever these were taken from.

    It is the shift at which the histograms of the walls' bearings, each point counted by its range, correlate best;
    of shifts that do alike the smaller one. None where no turn of a step makes them alike.
    Source: the rotation search of Censi, Iocchi and Grisetti, Scan matching in the Hough domain, ICRA 2005.
    """
    cosines = np.fft.irfft(np.conj(_wall_bearings(second)) * _wall_bearings(first), n=_BEARINGS)
    best = int(
        np.argmax(np.where(np.abs(_SHIFTS_RAD) <= _MOST_BY_WALLS_RAD, cosines - _DOUBTED_SHIFTS, -1.0))
    )
    return float(_SHIFTS_RAD[best]) if cosines[best] >= _LEAST_ALIKE else None


def _told(found: Verification) -> float:
    return found.overlap + found.agreement


def _wall_bearings(view: DepthView) -> npt.NDArray[np.complex128]:
    """Transform of the smoothed unit histogram of the bearings that the walls of a planar scan face."""
    from depthprint._kernels.scan_icp import line_normals

    scan = np.ascontiguousarray(view.counted[:, :2], dtype=np.float64)
    normals = np.empty_like(scan)
    line_normals(scan, _WALL_GAP_M, normals)
    known = normals.any(axis=1)
    turns = np.arctan2(normals[known, 1], normals[known, 0]) / math.tau
    counts = np.bincount(
        np.floor(turns * _BEARINGS).astype(np.int64) % _BEARINGS,
        weights=np.linalg.norm(scan[known], axis=1),
        minlength=_BEARINGS,
    )
    histogram = np.sqrt(np.maximum(np.fft.irfft(np.fft.rfft(counts) * _SMOOTHING, n=_BEARINGS), 0.0))
    return np.asarray(np.fft.rfft(histogram / max(float(np.linalg.norm(histogram)), 1e-12)))
