"""Where the streets are: the driven path as samples, cut into blocks that are seen for the first time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.simulation.route import Route

__all__ = ["SPACING_M", "Block", "StreetLine", "cut_blocks", "street_line"]

FloatArray = npt.NDArray[np.float64]

SPACING_M = 1.0
_RUN_OUT_M = 70.0
_SAME_STREET_M = 8.0
_REVISIT_GAP_M = 40.0


@dataclass(frozen=True)
class StreetLine:
    """The path every metre, prolonged straight at both ends so that no street ends in the void.

    positions_m (n, 2), headings_rad (n,) smoothed, novel (n,): not beside an earlier part of the path.
    """

    positions_m: FloatArray
    headings_rad: FloatArray
    novel: npt.NDArray[np.bool_]

    def at(self, arc_m: float, lateral_m: float) -> tuple[float, float, float]:
        """(x, y, heading) at ``arc_m`` along the line, ``lateral_m`` to its left."""
        i = int(np.clip(round(arc_m / SPACING_M), 0, len(self.positions_m) - 1))
        heading = float(self.headings_rad[i])
        x, y = self.positions_m[i]
        return float(x - lateral_m * np.sin(heading)), float(y + lateral_m * np.cos(heading)), heading


@dataclass(frozen=True)
class Block:
    """A stretch of street [start_m, end_m) along the line, without sharp turns."""

    start_m: float
    end_m: float


def street_line(route: Route) -> StreetLine:
    """Samples of the route, one a metre."""
    from scipy.spatial import cKDTree

    line = _with_run_out(route)
    steps = np.hypot(*np.diff(line, axis=0).T)
    keep = np.concatenate([[True], steps > 1e-6])
    arc = np.concatenate([[0.0], np.cumsum(steps)])[keep]
    at = np.arange(0.0, arc[-1], SPACING_M)
    positions = np.stack([np.interp(at, arc, line[keep, k]) for k in range(2)], axis=1)
    tangent = np.gradient(positions, axis=0)
    window = np.ones(9) / 9
    padded = np.concatenate([np.repeat(tangent[:1], 4, 0), tangent, np.repeat(tangent[-1:], 4, 0)])
    smooth = [np.convolve(padded[:, k], window, "valid") for k in range(2)]
    gap = int(_REVISIT_GAP_M / SPACING_M)
    neighbours = cKDTree(positions).query_ball_point(positions, _SAME_STREET_M)
    novel = np.array([min(near) > i - gap for i, near in enumerate(neighbours)])
    return StreetLine(positions, np.arctan2(smooth[1], smooth[0]), novel)


def cut_blocks(line: StreetLine, rng: np.random.Generator) -> list[Block]:
    """Blocks of 50 to 110 m over the novel samples, cut where the street turns."""
    heading = np.unwrap(line.headings_rad)
    turning = np.abs(heading - np.roll(heading, 12)) > np.radians(40)
    blocks: list[Block] = []
    start, limit = None, 0.0
    for i in range(len(heading)):
        street = bool(line.novel[i])
        if start is not None and (not street or (turning[i] and i - start > 15) or i - start >= limit):
            blocks.append(Block(start * SPACING_M, i * SPACING_M))
            start = None
        if start is None and street:
            start, limit = i, rng.uniform(50, 110)
    if start is not None:
        blocks.append(Block(start * SPACING_M, len(heading) * SPACING_M))
    return [block for block in blocks if block.end_m - block.start_m >= 4]


def _with_run_out(route: Route) -> FloatArray:
    positions, headings = route.positions_m, route.headings_rad
    reach = np.arange(_RUN_OUT_M, 0, -SPACING_M)[:, None]
    first = np.array([np.cos(headings[0]), np.sin(headings[0])])
    last = np.array([np.cos(headings[-1]), np.sin(headings[-1])])
    return np.concatenate([positions[0] - reach * first, positions, positions[-1] + reach[::-1] * last])
