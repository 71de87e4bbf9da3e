"""Lines the blocks of a street with parking, buildings, gardens, trees and poles, and fills what lies behind."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from depthprint.simulation.buildings import STYLES, BlockStyle, building, draw_style, garage
from depthprint.simulation.footprints import Footprint, GroundPlan
from depthprint.simulation.meshes import Triangles, moved
from depthprint.simulation.parking import SLOT_HALF_LENGTH_M, SLOT_HALF_WIDTH_M
from depthprint.simulation.street_furniture import BUSH_SPREAD, barrier, bush, pole, sign, tree
from depthprint.simulation.streets import SPACING_M, Block, StreetLine

__all__ = ["LANE_CLEARANCE_M", "Thing", "TownPlanner"]

LANE_CLEARANCE_M = 1.5
# The lane is known by samples; half way between two of them it must be as free.
_SAMPLE_CLEARANCE_M = math.hypot(LANE_CLEARANCE_M, 0.5 * SPACING_M)
_FACADE_REACH_M = 1.3
_RIGHT, _LEFT = -1, 1


@dataclass(frozen=True)
class Thing:
    """Something that stands still: its triangles in the world, and a circle about them."""

    kind: str
    x: float
    y: float
    radius: float
    triangles: Triangles


@dataclass(frozen=True)
class _Side:
    """One side of a block: its style and cross-section, as metres from the driven line."""

    style: BlockStyle
    side: int
    parking: float | None
    kerb: float
    sidewalk: float
    barrier_kind: str
    barrier_height: float
    tree_shape: str
    tree_height: float
    street_trees: bool
    occupancy: float

    @property
    def property_line(self) -> float:
        return self.kerb + self.sidewalk


class TownPlanner:
    """Places things block by block; everything placed keeps off the lanes and off each other."""

    def __init__(self, line: StreetLine, rng: np.random.Generator) -> None:
        self.plan = GroundPlan(line.positions_m)
        self.things: list[Thing] = []
        self.slots: list[tuple[float, float, float, float]] = []
        self._line, self._rng = line, rng
        self._drawn: dict[int, list[_Side]] = {_RIGHT: [], _LEFT: []}

    def plan_block(self, block: Block) -> None:
        """Line both sides of a block, from the kerb outwards."""
        for side in (self._draw_side(_RIGHT), self._draw_side(_LEFT)):
            self._parking(block, side)
            self._buildings(block, side)
            if side.style.garden[1] > 1.5:
                self._barriers(block, side)
                self._garden(block, side)
            self._sidewalk(block, side)

    def fill_background(self) -> None:
        """Buildings and trees behind the first row, so that gaps do not open on the void."""
        rng, line = self._rng, self._line
        length = len(line.positions_m)
        for arc in range(0, length, 5):
            for side in (_RIGHT, _LEFT):
                lateral = rng.uniform(22, 65)
                if rng.random() < 0.6:
                    style = STYLES[str(rng.choice(["detached", "apartments", "hall", "townhouse"]))]
                    self._building(style, arc, side, lateral, turn=rng.normal(0, 0.15))
                else:
                    self._tree(arc, side * lateral, str(rng.choice(["round", "cone"])), rng.uniform(6, 14))

    def _draw_side(self, side: int) -> _Side:
        """A new side, the last one continued, or one like an earlier street: towns repeat themselves."""
        rng, drawn = self._rng, self._drawn[side]
        choice = rng.random()
        if drawn and choice < 0.3:
            drawn.append(drawn[-1])
        elif len(drawn) > 3 and choice < 0.5:
            drawn.append(drawn[int(rng.integers(len(drawn)))])
        else:
            lane = 0.0 if side == _RIGHT else 2.9
            parking = lane + 2.95 if rng.random() < 0.8 else None
            drawn.append(
                _Side(
                    style=draw_style(rng),
                    side=side,
                    parking=parking,
                    kerb=lane + (4.05 if parking else rng.uniform(2.1, 2.9)),
                    sidewalk=rng.uniform(1.4, 3.2),
                    barrier_kind=str(rng.choice(["hedge", "wall", "fence"])),
                    barrier_height=float(rng.uniform(0.7, 2.0)),
                    tree_shape=str(rng.choice(["round", "round", "cone", "column"])),
                    tree_height=float(rng.uniform(5, 13)),
                    street_trees=bool(rng.random() < 0.4),
                    occupancy=float(rng.uniform(0.3, 0.9)),
                )
            )
        return drawn[-1]

    def _parking(self, block: Block, side: _Side) -> None:
        if side.parking is None:
            return
        for arc in np.arange(block.start_m + 3, block.end_m - 3, self._rng.uniform(5.8, 6.4)):
            x, y, heading = self._line.at(float(arc), side.side * side.parking)
            heading += math.pi if side.side == _LEFT else 0.0
            place = Footprint(x, y, heading, SLOT_HALF_LENGTH_M, SLOT_HALF_WIDTH_M)
            if self._rng.random() < 0.12 or not self._may_stand(place, margin=-0.1):
                continue
            self.plan.add(place)
            self.slots.append((x, y, heading, side.occupancy))

    def _buildings(self, block: Block, side: _Side) -> None:
        rng, style = self._rng, side.style
        facade = side.property_line + rng.uniform(*style.garden)
        arc = block.start_m + (rng.uniform(9, 13) if rng.random() < 0.3 else 0.0)
        while arc < block.end_m - 3:
            width = float(np.clip(rng.uniform(*style.width) * (1 + rng.normal(0, style.variety)), 4.5, 46))
            if rng.random() < style.empty_share:
                arc += width
                continue
            lateral = facade + rng.normal(0, 0.6 * style.variety)
            if self._building(style, arc + width / 2, side.side, max(lateral, side.property_line), width):
                gap = rng.uniform(*style.gap)
                if gap > 3.4 and rng.random() < 0.5:
                    self._garage(arc + width + gap / 2, side.side, lateral + rng.uniform(0, 4), gap - 0.4)
                arc += width + gap
            else:
                arc += 2.5

    def _building(
        self,
        style: BlockStyle,
        arc: float,
        side: int,
        lateral: float,
        width: float | None = None,
        turn: float = 0.0,
    ) -> bool:
        rng = self._rng
        width = float(rng.uniform(*style.width)) if width is None else width
        depth, eaves = float(rng.uniform(*style.depth)), float(rng.uniform(*style.eaves))
        x, y, heading = self._line.at(arc, side * lateral)
        heading += turn + (math.pi if side == _LEFT else 0.0)
        # The facade looks along local +y, which points at the street; the body lies behind it.
        reach = _FACADE_REACH_M
        middle = (reach - depth) / 2
        centre_x, centre_y = x - middle * math.sin(heading), y + middle * math.cos(heading)
        place = Footprint(centre_x, centre_y, heading, width / 2, (depth + reach) / 2)
        if not self._may_stand(place, margin=-0.35):
            return False
        shape = building(style, width, depth, eaves, rng)
        self._place("building", place, moved(shape, x, y, heading), 0.8)
        return True

    def _garage(self, arc: float, side: int, lateral: float, width: float) -> None:
        width, depth = min(width, 6.0), self._rng.uniform(5, 7)
        x, y, heading = self._line.at(arc, side * (lateral + depth / 2))
        heading += math.pi if side == _LEFT else 0.0
        place = Footprint(x, y, heading, width / 2, depth / 2)
        if self._may_stand(place, margin=-0.2):
            shape = moved(garage(width, depth, self._rng.uniform(2.3, 3.0)), 0.0, depth / 2)
            self._place("building", place, moved(shape, x, y, heading))

    def _barriers(self, block: Block, side: _Side) -> None:
        rng = self._rng
        thickness = {"hedge": 0.7, "wall": 0.25, "fence": 0.08}[side.barrier_kind]
        arc = block.start_m
        while arc < block.end_m - 3:
            length = rng.uniform(3.0, 5.0)
            if rng.random() < side.style.front_share * 0.85:
                x, y, heading = self._line.at(
                    arc + length / 2, side.side * (side.property_line + thickness / 2)
                )
                place = Footprint(x, y, heading, length / 2, thickness / 2)
                if self._may_stand(place, margin=-0.05):
                    height = side.barrier_height * rng.uniform(0.92, 1.08)
                    self._place("barrier", place, moved(barrier(length, height, thickness), x, y, heading))
            arc += length

    def _garden(self, block: Block, side: _Side) -> None:
        rng, style = self._rng, side.style
        deep = 30.0 if style.name == "park" else style.garden[1]
        arc = block.start_m + rng.uniform(0, style.tree_spacing[1])
        while arc < block.end_m:
            lateral = side.side * (side.property_line + rng.uniform(1.0, max(deep, 1.5)))
            if rng.random() < 0.55:
                shape = side.tree_shape if rng.random() < 0.6 else "round"
                self._tree(arc, lateral, shape, side.tree_height * rng.uniform(0.5, 1.2))
            else:
                radius = rng.uniform(0.5, 1.6)
                x, y, heading = self._line.at(arc, lateral)
                place = Footprint(x, y, heading, BUSH_SPREAD * radius, BUSH_SPREAD * radius)
                if self._may_stand(place):
                    shape_ = bush(radius, rng.uniform(0.8, 2.2), rng)
                    self._place("bush", place, moved(shape_, x, y, rng.uniform(0, 6)), 0.3)
            arc += rng.uniform(*style.tree_spacing) * 0.5

    def _sidewalk(self, block: Block, side: _Side) -> None:
        rng = self._rng
        if side.street_trees:
            spacing = rng.uniform(8, 16)
            for arc in np.arange(block.start_m + 2, block.end_m, spacing):
                lateral = side.side * (side.kerb + 0.7)
                self._tree(float(arc), lateral, side.tree_shape, side.tree_height * rng.uniform(0.85, 1.1))
        for arc in np.arange(block.start_m + rng.uniform(2, 25), block.end_m, rng.uniform(24, 36)):
            self._post("pole", float(arc), side, pole(rng.uniform(5, 9), rng.choice([0.0, 1.2])))
        for arc in rng.uniform(block.start_m, block.end_m, int(rng.poisson(1.5))):
            self._post(
                "sign", float(arc), side, sign(float(rng.choice([1.1, 1.4, 2.4, 2.8])), rng.uniform(0.5, 1.1))
            )

    def _post(self, kind: str, arc: float, side: _Side, shape: Triangles) -> None:
        x, y, heading = self._line.at(arc, side.side * (side.kerb + 0.45))
        place = Footprint(x, y, heading, 0.35, 0.35)
        if self._may_stand(place):
            turn = math.pi if side.side == _LEFT else 0.0
            self._place(kind, place, moved(shape, x, y, heading + turn), 1.5)

    def _tree(self, arc: float, lateral: float, shape: str, height: float) -> None:
        rng = self._rng
        height = float(np.clip(height, 3.5, 15))
        crown = height * rng.uniform(0.2, 0.34)
        x, y, heading = self._line.at(arc, lateral)
        half = 0.8 * crown if shape == "cone" else 0.5
        if shape == "cone":
            crown *= 0.75
        place = Footprint(x, y, heading, half, half)
        if self._may_stand(place):
            self._place(
                "tree", place, moved(tree(height, crown, shape, rng), x, y, rng.uniform(0, 6)), 1.2 * crown
            )

    def _may_stand(self, place: Footprint, margin: float = 0.0) -> bool:
        free = self.plan.lane_clearance(place, _SAMPLE_CLEARANCE_M) >= _SAMPLE_CLEARANCE_M
        return free and not self.plan.overlaps(place, margin)

    def _place(self, kind: str, place: Footprint, triangles: Triangles, reach: float = 0.0) -> None:
        self.plan.add(place)
        self.things.append(Thing(kind, place.x, place.y, place.radius + reach, triangles))
