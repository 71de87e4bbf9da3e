"""Pieces of simulated furniture, and the things that stand on them."""

from __future__ import annotations

import math

import numpy as np

from depthprint.simulation.meshes import Triangles, box, ellipsoid, lathe, merge, moved

__all__ = ["cabinet", "corner_piece", "desk", "dining_group", "shelf", "sofa"]


def shelf(rng: np.random.Generator) -> tuple[float, Triangles]:
    """Width in metres and triangles of a shelf with things on its boards; its back at y = 0."""
    w, d, h = rng.uniform(0.6, 1.2), rng.uniform(0.28, 0.4), rng.uniform(1.3, 2.1)
    boards = int(rng.integers(4, 7))
    parts = [box(-w / 2, w / 2, 0, 0.02, 0, h)]
    parts += [box(x - 0.015, x + 0.015, 0, d, 0, h) for x in (-w / 2, w / 2)]
    for z in np.linspace(0.08, h, boards):
        parts.append(box(-w / 2, w / 2, 0, d, z - 0.02, z))
    for z in np.linspace(0.08, h, boards)[:-1]:
        parts += _things(rng, w - 0.1, d, z, min(0.22, h / boards - 0.05), int(rng.integers(2, 6)))
    return w + 0.03, merge(parts)


def cabinet(rng: np.random.Generator) -> tuple[float, Triangles]:
    """Width in metres and triangles of a cabinet, a low one with things on it; its back at y = 0."""
    w, d, h = rng.uniform(0.5, 1.2), rng.uniform(0.4, 0.6), rng.choice([0.8, 0.9, 1.9])
    doors = 2 if w > 0.8 else 1
    parts = [box(-w / 2, w / 2, 0, d, 0.06, h), box(-w / 2 + 0.03, w / 2 - 0.03, 0, d - 0.05, 0, 0.06)]
    for x in np.arange(doors) * w / doors - w / 2:
        parts.append(box(x + 0.01, x + w / doors - 0.01, d, d + 0.02, 0.1, h - 0.03))
        parts.append(box(x + 0.06, x + 0.08, d + 0.02, d + 0.05, h / 2, h / 2 + 0.15))
    if h < 1.5:
        parts += _things(rng, w - 0.1, d, h, 0.35, int(rng.integers(1, 5)))
    return w, merge(parts)


def sofa(rng: np.random.Generator) -> tuple[float, Triangles]:
    """Width in metres and triangles of an armchair or sofa; its back at y = 0."""
    w, d, back, arm = rng.uniform([1.0, 0.75, 0.7, 0.5], [2.2, 0.9, 0.9, 0.62])
    seats = 1 if w < 1.2 else 2 if w < 1.8 else 3
    parts = [box(-w / 2, w / 2, 0, d, 0.08, 0.3), box(-w / 2, w / 2, 0, 0.2, 0.08, back)]
    parts += [box(x, x + 0.18, 0, d, 0.08, arm) for x in (-w / 2, w / 2 - 0.18)]
    seat = (w - 0.36) / seats
    for x in np.arange(seats) * seat - w / 2 + 0.18:
        parts.append(box(x + 0.01, x + seat - 0.01, 0.2, d + 0.02, 0.3, 0.44))
        if rng.random() < 0.6:
            cushion = ellipsoid((0.2, 0.09, 0.18), (0.0, 0.0, 0.0), sides=12)
            parts.append(moved(cushion, x + seat / 2, 0.3, rng.uniform(-0.5, 0.5), 0.58))
    return w, merge(parts)


def desk(rng: np.random.Generator) -> tuple[float, Triangles]:
    """Width in metres and triangles of a desk with a screen, and a chair before it; its back at y = 0."""
    w, d = rng.uniform(1.0, 1.6), rng.uniform(0.6, 0.8)
    parts = [_table_top(rng, w, d), *_things(rng, w - 0.2, d, 0.74, 0.3, int(rng.integers(2, 6)))]
    parts += [box(-0.27, 0.27, 0.15, 0.18, 0.84, 1.17), box(-0.03, 0.03, 0.12, 0.15, 0.74, 1.0)]
    parts.append(moved(_chair(rng), 0.0, d + 0.05, rng.uniform(2.6, 3.6)))
    return w, merge(parts)


def _table_top(rng: np.random.Generator, w: float, d: float) -> Triangles:
    """Plate at 0.74 m on four legs or two side boards; its back at y = 0."""
    parts = [box(-w / 2, w / 2, 0, d, 0.70, 0.74)]
    if rng.random() < 0.3:
        parts += [box(x - 0.02, x + 0.02, 0.03, d - 0.03, 0, 0.70) for x in (-w / 2 + 0.05, w / 2 - 0.05)]
        return merge(parts)
    legs = [(x, y) for x in (-w / 2 + 0.06, w / 2 - 0.06) for y in (0.06, d - 0.06)]
    return merge([*parts, *(box(x - 0.03, x + 0.03, y - 0.03, y + 0.03, 0, 0.70) for x, y in legs)])


def _chair(rng: np.random.Generator) -> Triangles:
    """Chair about the origin that looks along y."""
    s, h, back = 0.22, rng.uniform(0.42, 0.48), rng.uniform(0.8, 0.98)
    legs = [box(x - 0.02, x + 0.02, y - 0.02, y + 0.02, 0, h) for x in (-s, s) for y in (-s, s)]
    posts = [box(x - 0.02, x + 0.02, -s - 0.02, -s + 0.02, h, back) for x in (-s, s)]
    rest = box(-s, s, -s - 0.015, -s + 0.015, rng.uniform(h + 0.05, back - 0.2), back)
    return merge([*legs, *posts, rest, box(-s - 0.02, s + 0.02, -s - 0.02, s + 0.02, h - 0.04, h)])


def dining_group(rng: np.random.Generator, a: float, b: float) -> list[Triangles]:
    """A table near the middle of the room with things on it and chairs about it."""
    w, d, heading = rng.uniform(0.9, 1.7), rng.uniform(0.7, 0.9), rng.uniform(0, math.pi)
    x, y = rng.uniform(-0.2, 0.2) * a, rng.uniform(-0.2, 0.2) * b
    parts = [_table_top(rng, w, d), *_things(rng, w - 0.2, d, 0.74, 0.25, int(rng.integers(1, 7)))]
    for side in (-0.15, d + 0.15):
        for place in (-w / 4, w / 4):
            if rng.random() < 0.7:
                facing = (0.0 if side < 0 else math.pi) + rng.normal(0, 0.2)
                parts.append(moved(_chair(rng), place, side, facing))
    centred = moved(merge(parts), 0.0, -d / 2)
    return [moved(centred, x, y, heading)]


def corner_piece(rng: np.random.Generator) -> Triangles:
    """A plant, a floor lamp, a bin or a ball about the origin."""
    kind = rng.integers(4)
    if kind == 0:
        pot = lathe([(0.0, 0.0), (0.13, 0.0), (0.18, 0.35), (0.03, 0.35), (0.02, 0.7)], 12)
        radius = rng.uniform(0.2, 0.33)
        crown = ellipsoid((radius, radius, 0.35), (0.0, 0.0, 1.0), rng.uniform(0.7, 1.2, 6))
        return merge([pot, crown])
    if kind == 1:
        profile = [
            (0.0, 0.0),
            (0.15, 0.0),
            (0.15, 0.03),
            (0.015, 0.04),
            (0.015, 1.45),
            (0.2, 1.45),
            (0.12, 1.7),
        ]
        return lathe(profile, 12)
    if kind == 2:
        height = rng.uniform(0.3, 0.6)
        return lathe([(0.0, 0.0), (0.14, 0.0), (0.18, height), (0.16, height), (0.13, 0.03), (0.0, 0.03)], 14)
    radius = rng.uniform(0.15, 0.33)
    return ellipsoid((radius, radius, radius), (0.0, 0.0, radius), sides=16)


def _things(
    rng: np.random.Generator, w: float, d: float, z: float, tallest: float, count: int
) -> list[Triangles]:
    """Boxes, books, bottles, cans and balls in a row of width ``w`` and depth ``d`` on a board at ``z``."""
    things = []
    for x in (np.arange(count) + 0.5) * w / count - w / 2:
        half, h = min(rng.uniform(0.03, 0.12), w / count / 2), rng.uniform(0.4, 1.0) * tallest
        kind = rng.integers(4)
        if kind == 0:
            thing = box(-half, half, -0.07, 0.07, 0, h)
        elif kind == 1:
            thing = merge(
                [box(s - 0.012, s + 0.012, -0.08, 0.08, 0, h) for s in np.arange(-half, half, 0.03).tolist()]
            )
        elif kind == 2:
            r = min(half, 0.05)
            thing = lathe([(0.0, 0.0), (r, 0.0), (r, 0.6 * h), (r / 3, 0.75 * h), (r / 3, h), (0.0, h)], 12)
        else:
            r = min(half, h / 2)
            thing = ellipsoid((r, r, r), (0.0, 0.0, r), sides=14)
        turn = 0.0 if kind == 1 else rng.uniform(-0.4, 0.4)
        things.append(moved(thing, x, d / 2 + rng.uniform(-0.3, 0.3) * max(0.0, d - 0.2), turn, z))
    return things
