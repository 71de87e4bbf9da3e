"""A town along a route, from a seed: what stands still, where cars may park, and where they drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.simulation.footprints import Footprint, GroundPlan
from depthprint.simulation.meshes import Triangles
from depthprint.simulation.parking import ParkingSlots
from depthprint.simulation.route import Route, check_seed
from depthprint.simulation.streets import StreetLine, cut_blocks, street_line
from depthprint.simulation.town_planner import TownPlanner

__all__ = ["StreetWorld", "build_street_world"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class StreetWorld:
    """What all visits share.

    triangles: (n, 3, 3) float32 metres, z up, ground at 0, sorted by thing; ``first_triangle`` (m + 1,) cuts them.
    centres_m (m, 2) and radii_m (m,): a circle about each thing; kinds: its sort, e.g. 'building', 'tree'.
    """

    seed: int
    route: Route
    line: StreetLine
    plan: GroundPlan
    triangles: Triangles
    first_triangle: npt.NDArray[np.int64]
    centres_m: FloatArray
    radii_m: FloatArray
    kinds: tuple[str, ...]
    slots: ParkingSlots

    def within(self, positions_m: FloatArray, reach_m: float) -> Triangles:
        """Triangles of all things that come within ``reach_m`` of any of the positions (k, 2), and the ground."""
        offset = self.centres_m[None] - np.atleast_2d(positions_m)[:, None]
        chosen = (np.hypot(offset[..., 0], offset[..., 1]) < reach_m + self.radii_m).any(axis=0)
        counts = np.diff(self.first_triangle)
        things = self.triangles[np.repeat(chosen, counts)]
        low, high = np.min(positions_m, axis=0) - 2 * reach_m, np.max(positions_m, axis=0) + 2 * reach_m
        a, b = (low[0], low[1], 0.0), (high[0], low[1], 0.0)
        c, d = (high[0], high[1], 0.0), (low[0], high[1], 0.0)
        return np.concatenate([np.array([(a, b, c), (a, c, d)], dtype=np.float32), things])

    def is_free(self, footprint: Footprint, margin_m: float) -> bool:
        """Whether nothing stands within ``margin_m`` of the rectangle, parking slots included."""
        return not self.plan.overlaps(footprint, margin_m)


def build_street_world(route: Route, seed: int = 0) -> StreetWorld:
    """Line the streets of a route with a town of the given seed; the same seed gives the same bits.

    Nothing is placed nearer than 1.5 m to the driven path, wherever the path crosses itself or comes back
    beside itself; tree crowns may hang over it, above 2.3 m. Raises SettingsError for a wrong seed.
    """
    check_seed(seed)
    rng = np.random.default_rng([seed, 11])
    line = street_line(route)
    planner = TownPlanner(line, rng)
    for block in cut_blocks(line, rng):
        planner.plan_block(block)
    planner.fill_background()
    things = planner.things
    counts = np.array([len(thing.triangles) for thing in things], dtype=np.int64)
    slots = planner.slots
    return StreetWorld(
        seed=seed,
        route=route,
        line=line,
        plan=planner.plan,
        triangles=np.concatenate([thing.triangles for thing in things]),
        first_triangle=np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)]),
        centres_m=np.array([(thing.x, thing.y) for thing in things]),
        radii_m=np.array([thing.radius for thing in things]),
        kinds=tuple(thing.kind for thing in things),
        slots=ParkingSlots(
            np.array([slot[:2] for slot in slots]).reshape(-1, 2),
            np.array([slot[2] for slot in slots]),
            np.array([slot[3] for slot in slots]),
        ),
    )
