"""Parked cars: fixed slots along the kerbs, whose cars are drawn anew for a share of them at each visit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.simulation.cars import CAR_MODELS, car_body
from depthprint.simulation.meshes import Triangles, merge, moved
from depthprint.simulation.route import Route

__all__ = ["ParkedCar", "ParkingSlots", "parked_car", "parked_cars", "visit_switches"]

FloatArray = npt.NDArray[np.float64]

SLOT_HALF_LENGTH_M = 2.85
SLOT_HALF_WIDTH_M = 1.1
_NEAR_M = 30.0
_AWAY_M = 60.0


@dataclass(frozen=True)
class ParkingSlots:
    """Slots of a world: ``positions_m`` (n, 2), ``headings_rad`` (n,), ``occupancy`` (n,) chance of a car in 0..1."""

    positions_m: FloatArray
    headings_rad: FloatArray
    occupancy: FloatArray

    def __len__(self) -> int:
        return len(self.positions_m)


@dataclass(frozen=True)
class ParkedCar:
    """A car in its slot: index into CAR_MODELS, size factor, offsets in metres, heading offset in radians."""

    model: int
    scale: float
    along_m: float
    across_m: float
    turn_rad: float


def visit_switches(slots: ParkingSlots, route: Route) -> tuple[FloatArray, ...]:
    """For each slot the arc lengths (metres driven) at which a new visit begins; none where it is seen once.

    The vehicle visits a slot while within 30 m of it; when it has driven at least 60 m elsewhere and comes back,
    that is a new visit, which counts from half way between the two.
    """
    from scipy.spatial import cKDTree

    arc = route.arc_m
    if not len(slots):
        return ()
    near = cKDTree(route.positions_m).query_ball_point(slots.positions_m, _NEAR_M)
    switches = []
    for frames in near:
        at = arc[np.sort(np.asarray(frames, dtype=np.int64))]
        away = np.diff(at) > _AWAY_M
        switches.append((at[:-1][away] + at[1:][away]) / 2)
    return tuple(switches)


def parked_car(seed: int, slot: int, visit: int, occupancy: float, cars_redrawn: float) -> ParkedCar | None:
    """The car in a slot at a visit, or None: that of the latest visit at which the slot was drawn anew.

    Whether a visit draws anew is decided by a number of the slot and visit alone, so that a larger
    ``cars_redrawn`` only adds changes.
    """
    while visit > 0 and np.random.default_rng([seed, 31, slot, visit]).random() >= cars_redrawn:
        visit -= 1
    rng = np.random.default_rng([seed, 37, slot, visit])
    if rng.random() >= occupancy:
        return None
    return ParkedCar(
        model=int(rng.integers(len(CAR_MODELS))),
        scale=float(rng.uniform(0.97, 1.03)),
        along_m=float(rng.uniform(-0.4, 0.4)),
        across_m=float(rng.uniform(-0.12, 0.12)),
        turn_rad=float(rng.normal(0.0, 0.02) + (np.pi if rng.random() < 0.15 else 0.0)),
    )


def parked_cars(
    seed: int,
    slots: ParkingSlots,
    chosen: npt.NDArray[np.int64],
    visits: npt.NDArray[np.int64],
    cars_redrawn: float,
) -> Triangles:
    """Triangles of the cars in the ``chosen`` slots, each at its visit."""
    parts = []
    for slot, visit in zip(chosen.tolist(), visits.tolist(), strict=True):
        car = parked_car(seed, slot, visit, float(slots.occupancy[slot]), cars_redrawn)
        if car is None:
            continue
        x, y = slots.positions_m[slot]
        heading = float(slots.headings_rad[slot])
        x += car.along_m * np.cos(heading) - car.across_m * np.sin(heading)
        y += car.along_m * np.sin(heading) + car.across_m * np.cos(heading)
        parts.append(moved(car_body(CAR_MODELS[car.model], car.scale), x, y, heading + car.turn_rad))
    return merge(parts)
