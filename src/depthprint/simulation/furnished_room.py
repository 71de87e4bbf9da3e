"""One simulated room: walls with a door and windows, and furniture along them."""

from __future__ import annotations

import math

import numpy as np

from depthprint.simulation.furniture import cabinet, corner_piece, desk, dining_group, shelf, sofa
from depthprint.simulation.meshes import Triangles, box, lathe, merge, moved

__all__ = ["furnished_room"]


def furnished_room(rng: np.random.Generator) -> tuple[float, float, Triangles]:
    """Width, depth and triangles of a room about the origin, its floor at z = 0."""
    width, depth, height = rng.uniform(4.2, 6.5), rng.uniform(3.8, 5.5), rng.uniform(2.4, 2.9)
    a, b = width / 2, depth / 2
    parts = [box(-a, a, -b, b, -0.1, 0.0), box(-a, a, -b, b, height, height + 0.1)]
    walls = ((0.0, b, width), (math.pi, b, width), (math.pi / 2, a, depth), (-math.pi / 2, a, depth))
    door_wall = int(rng.integers(4))
    for number, (heading, distance, length) in enumerate(walls):
        door = number == door_wall
        wall = merge([_wall(rng, length, height, door), *_along_wall(rng, length, door)])
        parts.append(moved(wall, distance * math.sin(heading), -distance * math.cos(heading), heading))
    for x in (-a + 0.35, a - 0.35):
        for y in (-b + 0.35, b - 0.35):
            if rng.random() < 0.6:
                parts.append(moved(corner_piece(rng), x, y))
    if rng.random() < 0.8:
        parts += dining_group(rng, a, b)
    lamp = lathe([(0.02, 0.5), (0.02, 0.3), (0.08, 0.3), (0.25, 0.0)], 12)
    parts.append(moved(lamp, rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), z=height - 0.5))
    return width, depth, merge(parts)


def _wall(rng: np.random.Generator, length: float, height: float, door: bool) -> Triangles:
    """Wall along x, its inner face at y = 0, with a door or, often, a window set back in it."""
    half = length / 2
    if door:
        x0, x1, z0, z1, recess = -0.45, 0.45, 0.0, 2.05, 0.08
    elif rng.random() < 0.5:
        centre, w = rng.uniform(-half / 3, half / 3), rng.uniform(0.4, 0.8)
        x0, x1, z0, z1, recess = centre - w, centre + w, 0.95, 2.1, 0.18
    else:
        return box(-half, half, -0.2, 0.0, 0.0, height)
    return merge(
        [
            box(-half, x0, -0.2, 0.0, 0.0, height),
            box(x1, half, -0.2, 0.0, 0.0, height),
            box(x0, x1, -0.2, 0.0, z1, height),
            box(x0, x1, -0.2, 0.0, -0.1, z0),
            box(x0, x1, -0.25, -recess, z0, z1),
        ]
    )


def _along_wall(rng: np.random.Generator, length: float, door: bool) -> list[Triangles]:
    """Furniture side by side with its back to the wall, clear of the corners and of the door."""
    kinds = (shelf, cabinet, sofa, desk, shelf, cabinet)
    pieces: list[Triangles] = []
    x, end = -length / 2 + 0.75, length / 2 - 0.75
    while True:
        width, triangles = kinds[rng.integers(len(kinds))](rng)
        gap = float(rng.uniform(0.03, 0.5))
        if door and x < 0.6 and x + gap + width > -0.6:
            x, door = 0.6, False
            continue
        if x + gap + width > end:
            return pieces
        pieces.append(moved(triangles, x + gap + width / 2, 0.02))
        x += gap + width
