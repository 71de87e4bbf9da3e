"""Ground plan: which oriented rectangles are taken, and how far they are from the driven lanes."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Footprint", "GroundPlan"]

FloatArray = npt.NDArray[np.float64]
_CELL_M = 16.0


@dataclass(frozen=True)
class Footprint:
    """Rectangle on the ground: centre and half sizes in metres, ``heading_rad`` of its length."""

    x: float
    y: float
    heading_rad: float
    half_length: float
    half_width: float

    @property
    def radius(self) -> float:
        """Half the diagonal, metres."""
        return math.hypot(self.half_length, self.half_width)


class GroundPlan:
    """Rectangles placed so far, and the points of the driven lanes ``lane_m`` (n, 2) that must stay free."""

    def __init__(self, lane_m: FloatArray) -> None:
        from scipy.spatial import cKDTree

        self._lane = np.asarray(lane_m, dtype=np.float64)
        self._tree = cKDTree(self._lane)
        self._rows: list[tuple[float, float, float, float, float]] = []
        self._cells: dict[tuple[int, int], list[int]] = defaultdict(list)

    def __len__(self) -> int:
        return len(self._rows)

    def lane_clearance(self, footprint: Footprint, limit_m: float) -> float:
        """Distance in metres from the rectangle to the nearest lane point, inf when it is beyond ``limit_m``."""
        near = self._tree.query_ball_point((footprint.x, footprint.y), footprint.radius + limit_m)
        if not near:
            return math.inf
        c, s = math.cos(footprint.heading_rad), math.sin(footprint.heading_rad)
        offset = self._lane[near] - (footprint.x, footprint.y)
        along = np.abs(offset[:, 0] * c + offset[:, 1] * s) - footprint.half_length
        across = np.abs(offset[:, 1] * c - offset[:, 0] * s) - footprint.half_width
        return float(np.hypot(np.maximum(along, 0), np.maximum(across, 0)).min())

    def overlaps(self, footprint: Footprint, margin_m: float = 0.0) -> bool:
        """Whether the rectangle, grown by ``margin_m`` on each side, meets one that is there already."""
        found = sorted({i for cell in self._covered(footprint, margin_m) for i in self._cells.get(cell, ())})
        if not found:
            return False
        others = np.array([self._rows[i] for i in found])
        length, width = footprint.half_length + margin_m, footprint.half_width + margin_m
        shift = others[:, :2] - (footprint.x, footprint.y)
        turn = others[:, 2] - footprint.heading_rad
        cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        apart = np.zeros(len(others), dtype=bool)
        c, s = math.cos(footprint.heading_rad), math.sin(footprint.heading_rad)
        apart |= np.abs(shift[:, 0] * c + shift[:, 1] * s) > length + others[:, 3] * cos + others[:, 4] * sin
        apart |= np.abs(shift[:, 1] * c - shift[:, 0] * s) > width + others[:, 3] * sin + others[:, 4] * cos
        c, s = np.cos(others[:, 2]), np.sin(others[:, 2])
        apart |= np.abs(shift[:, 0] * c + shift[:, 1] * s) > others[:, 3] + length * cos + width * sin
        apart |= np.abs(shift[:, 1] * c - shift[:, 0] * s) > others[:, 4] + length * sin + width * cos
        return not bool(apart.all())

    def add(self, footprint: Footprint) -> None:
        """Take the rectangle."""
        for cell in self._covered(footprint, 0.0):
            self._cells[cell].append(len(self._rows))
        row = (footprint.x, footprint.y, footprint.heading_rad, footprint.half_length, footprint.half_width)
        self._rows.append(row)

    def _covered(self, footprint: Footprint, margin_m: float) -> list[tuple[int, int]]:
        reach = footprint.radius + margin_m * 1.5
        x0, x1 = int((footprint.x - reach) // _CELL_M), int((footprint.x + reach) // _CELL_M)
        y0, y1 = int((footprint.y - reach) // _CELL_M), int((footprint.y + reach) // _CELL_M)
        return [(i, j) for i in range(x0, x1 + 1) for j in range(y0, y1 + 1)]
