"""Cars that move: others on the road at each moment, never the same twice."""

from __future__ import annotations

import math

import numpy as np

from depthprint.simulation.cars import CAR_MODELS, car_body
from depthprint.simulation.meshes import Triangles, merge, moved
from depthprint.simulation.route import Route

__all__ = ["Traffic"]

_ONCOMING_EVERY_M = 70.0
_LEADER_STRETCH_M = 120.0
_LEADER_SHARE = 0.25
_ONCOMING_LANE_M = 2.9
_SIGHT_M = 80.0


class Traffic:
    """Oncoming cars and cars ahead, along a route, from a seed.

    Oncoming cars meet the vehicle at random points of its drive, at its own speed. On some stretches a car drives
    ahead at a distance that varies.
    """

    def __init__(self, route: Route, seed: int) -> None:
        rng = np.random.default_rng([seed, 53])
        self._arc = route.arc_m
        self._route = route
        length = float(self._arc[-1])
        self._meetings = np.sort(rng.uniform(0, length, rng.poisson(length / _ONCOMING_EVERY_M)))
        self._models = rng.integers(len(CAR_MODELS), size=len(self._meetings))
        stretches = int(length / _LEADER_STRETCH_M) + 1
        self._leads = rng.random(stretches) < _LEADER_SHARE
        self._leader_models = rng.integers(len(CAR_MODELS), size=stretches)
        self._leader_gaps = rng.uniform(9.0, 30.0, stretches)

    def at(self, frame: int) -> Triangles:
        """Triangles of the moving cars about the vehicle in a frame."""
        here = float(self._arc[frame])
        parts = []
        for meeting, model in zip(self._meetings, self._models, strict=True):
            if abs(meeting - here) < _SIGHT_M / 2:
                parts += self._car(2 * meeting - here, int(model), _ONCOMING_LANE_M, math.pi)
        stretch = int(here / _LEADER_STRETCH_M)
        if self._leads[stretch]:
            gap = float(self._leader_gaps[stretch]) + 3.0 * math.sin(here / 17.0)
            parts += self._car(here + gap, int(self._leader_models[stretch]), 0.0, 0.0)
        return merge(parts)

    def _car(self, arc_m: float, model: int, lateral_m: float, turn_rad: float) -> list[Triangles]:
        if not self._arc[0] <= arc_m <= self._arc[-1]:
            return []
        x, y = (float(np.interp(arc_m, self._arc, axis)) for axis in self._route.positions_m.T)
        heading = float(np.interp(arc_m, self._arc, np.unwrap(self._route.headings_rad)))
        x, y = x - lateral_m * math.sin(heading), y + lateral_m * math.cos(heading)
        return [moved(car_body(CAR_MODELS[model]), x, y, heading + turn_rad)]
