"""Shapes of simulated objects: a category is a random grammar of parts, an instance varies their proportions."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from depthprint.simulation.meshes import Triangles, box, lathe, merge, moved

__all__ = ["Proportions", "grow"]

FloatArray = npt.NDArray[np.float64]

INSTANCE_SPREAD = 0.12
SIDES = 20


class Proportions:
    """Choices belong to the category; lengths too, and each instance scales them a little."""

    def __init__(self, grammar: np.random.Generator, variation: np.random.Generator) -> None:
        self._grammar = grammar
        self._variation = variation

    def pick(self, *options: str) -> str:
        """One of the options, the category's choice."""
        return options[int(self._grammar.integers(len(options)))]

    def count(self, low: int, high: int) -> int:
        """A number from low to high, the category's choice."""
        return int(self._grammar.integers(low, high + 1))

    def length(self, low: float, high: float) -> float:
        """A length of the category between low and high, varied by the instance."""
        typical = math.exp(self._grammar.uniform(math.log(low), math.log(high)))
        return typical * math.exp(INSTANCE_SPREAD * float(np.clip(self._variation.normal(), -2, 2)))


def grow(p: Proportions) -> Triangles:
    """Object of a category, 10 to 22 cm or so in its largest extent, standing on z = 0 at the origin."""
    body = _body(p)
    under = _UNDER[p.pick(*_UNDER)](p, body)
    top = _ON_TOP[p.pick(*_ON_TOP)](p, body)
    beside = _BESIDE[p.pick(*_BESIDE)](p, body)
    whole = merge([body, under, top, beside])
    low, high = _extent(whole)
    scale = p.length(0.10, 0.22) / float((high - low).max())
    middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    return np.asarray((whole - middle) * scale, dtype=np.float32)


def _body(p: Proportions) -> Triangles:
    """The main part, of size 1 or so, its lowest point at z = 0."""
    kind = p.pick("box", "slab", "cylinder", "lying cylinder", "sphere", "capsule", "lathe", "lathe", "bowl")
    w, d, h = p.length(0.4, 1.2), p.length(0.3, 0.9), p.length(0.3, 1.5)
    if kind == "box":
        return box(-w / 2, w / 2, -d / 2, d / 2, 0.0, h)
    if kind == "slab":
        return box(-w / 2, w / 2, -d / 2, d / 2, 0.0, 0.15 * h)
    if kind == "cylinder":
        return _cylinder(d / 2, h)
    if kind == "lying cylinder":
        return _rod((-h / 2, 0.0, d / 3), (h / 2, 0.0, d / 3), d / 3)
    if kind == "sphere":
        return np.asarray(_sphere(0.5) * np.array([w, d, min(h, 1.0)]), dtype=np.float32)
    if kind == "capsule":
        return _capsule(0.35 * d, h)
    if kind == "bowl":
        return lathe(
            [(0.0, 0.0), (0.2 * w, 0.0), (0.5 * w, 0.4 * h), (0.47 * w, 0.4 * h), (0.0, 0.05 * h)], SIDES
        )
    radii = [0.5 * d * p.length(0.4, 1.3) for _ in range(p.count(3, 5))]
    heights = np.linspace(0.0, h, len(radii)).tolist()
    return lathe([(0.0, 0.0), *zip(radii, heights, strict=True), (0.0, h)], SIDES)


def _nothing(p: Proportions, body: Triangles) -> Triangles:
    return merge([])


def _legs(p: Proportions, body: Triangles) -> Triangles:
    low, high = _extent(body)
    length, radius, splay = p.length(0.2, 0.9), p.length(0.025, 0.06), p.length(0.7, 1.2)
    count = p.count(3, 4)
    legs = []
    for angle in (np.arange(count) + 0.5) * 2 * math.pi / count:
        foot = 0.42 * (high - low)[:2] * [math.cos(angle), math.sin(angle)] * math.sqrt(count / 2)
        legs.append(_rod((foot[0], foot[1], 0.1), (foot[0] * splay, foot[1] * splay, -length), radius))
    return merge(legs)


def _wheels(p: Proportions, body: Triangles) -> Triangles:
    low, high = _extent(body)
    radius, width = p.length(0.12, 0.3), p.length(0.06, 0.15)
    return merge(
        [
            _rod((x, y, 0.0), (x, y + math.copysign(width, y), 0.0), radius)
            for x in (0.65 * low[0], 0.65 * high[0])
            for y in (low[1], high[1])
        ]
    )


def _pedestal(p: Proportions, body: Triangles) -> Triangles:
    length, stem, foot = p.length(0.2, 1.0), p.length(0.04, 0.1), p.length(0.2, 0.45)
    profile = [(0.0, -length), (foot, -length), (foot, 0.05 - length), (stem, 0.12 - length), (stem, 0.1)]
    return lathe(profile, SIDES)


def _lid(p: Proportions, body: Triangles) -> Triangles:
    low, high = _extent(body)
    radius, knob = 0.4 * float((high - low)[:2].min()), p.length(0.05, 0.12)
    lid = merge([_cylinder(radius, 0.06), moved(_sphere(knob), 0.0, 0.0, z=0.05)])
    return moved(lid, 0.0, 0.0, z=float(high[2]))


def _cone(p: Proportions, body: Triangles) -> Triangles:
    low, high = _extent(body)
    wide, tip = 0.5 * float((high - low)[:2].min()) * p.length(0.5, 1.3), p.length(0.03, 0.12)
    tall, z = p.length(0.2, 0.8), float(high[2])
    return lathe([(wide, z), (tip, z + tall), (0.0, z + tall)], SIDES)


def _head(p: Proportions, body: Triangles) -> Triangles:
    radius, neck = p.length(0.12, 0.35), p.length(0.05, 0.3)
    forward = p.length(0.1, 0.6) * float(_extent(body)[1][0])
    top = float(_extent(body)[1][2])
    head = moved(_sphere(radius), forward, 0.0, z=top + neck)
    return merge(
        [head, _rod((forward / 2, 0.0, top - 0.15), (forward, 0.0, top + neck + radius), radius / 2)]
    )


def _back(p: Proportions, body: Triangles) -> Triangles:
    low, high = _extent(body)
    thick, tall = p.length(0.05, 0.12), p.length(0.3, 1.0)
    return box(
        float(low[0]), float(low[0]) + thick, float(low[1]), float(high[1]), 0.0, float(high[2]) + tall
    )


def _handle(p: Proportions, body: Triangles) -> Triangles:
    _, high = _extent(body)
    reach, radius = p.length(0.15, 0.4), p.length(0.03, 0.06)
    tall, middle = p.length(0.5, 0.9) * float(high[2]) / 2, float(high[2]) / 2
    angles = np.linspace(-math.pi / 2, math.pi / 2, 7)
    x, z = 0.9 * high[0] + reach * np.cos(angles), middle + tall * np.sin(angles)
    points = [(float(a), 0.0, float(b)) for a, b in zip(x, z, strict=True)]
    return merge([_rod(a, b, radius) for a, b in pairwise(points)])


def _arms(p: Proportions, body: Triangles) -> Triangles:
    low, high = _extent(body)
    reach, lift, radius = p.length(0.2, 0.9), p.length(0.1, 0.8), p.length(0.04, 0.1)
    z = float(high[2]) * 0.6
    return merge(
        [
            _rod((0.0, 0.8 * y, z), (0.0, y + math.copysign(reach, y), z + lift), radius)
            for y in (low[1], high[1])
        ]
    )


def _spout(p: Proportions, body: Triangles) -> Triangles:
    _, high = _extent(body)
    reach, lift, radius = p.length(0.2, 0.7), p.length(0.1, 0.7), p.length(0.05, 0.1)
    z = float(high[2]) * 0.5
    return _rod((0.6 * high[0], 0.0, z), (high[0] + reach, 0.0, z + lift), radius)


def _fins(p: Proportions, body: Triangles) -> Triangles:
    _, high = _extent(body)
    chord, span, z = p.length(0.15, 0.5), p.length(0.4, 1.2), float(high[2]) * 0.5
    reach = float(high[1]) + span
    return box(-chord / 2, chord / 2, -reach, reach, z, z + 0.05)


_Part = Callable[[Proportions, Triangles], Triangles]
_UNDER: dict[str, _Part] = {"none": _nothing, "legs": _legs, "wheels": _wheels, "pedestal": _pedestal}
_ON_TOP: dict[str, _Part] = {"none": _nothing, "lid": _lid, "cone": _cone, "head": _head, "back": _back}
_BESIDE: dict[str, _Part] = {
    "none": _nothing, "handle": _handle, "arms": _arms, "spout": _spout, "fins": _fins,
}  # fmt: skip


def _extent(triangles: Triangles) -> tuple[FloatArray, FloatArray]:
    corners = triangles.reshape(-1, 3).astype(np.float64)
    return corners.min(axis=0), corners.max(axis=0)


def _cylinder(radius: float, height: float) -> Triangles:
    return lathe([(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)], SIDES)


def _sphere(radius: float) -> Triangles:
    return _capsule(radius, 0.0)


def _capsule(radius: float, length: float) -> Triangles:
    """Cylinder with half a sphere at both ends, on z = 0; of length 0 a sphere."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, 12)
    z = radius + radius * np.sin(angles) + length * (angles > 0)
    return lathe(list(zip((radius * np.cos(angles)).tolist(), z.tolist(), strict=True)), SIDES)


def _rod(start: tuple[float, float, float], end: tuple[float, float, float], radius: float) -> Triangles:
    """Cylinder from one point to another."""
    along = np.subtract(end, start).astype(float)
    length = float(np.linalg.norm(along))
    axis = along / length
    aside = np.cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.9 else (0.0, 1.0, 0.0))
    aside /= np.linalg.norm(aside)
    frame = np.stack([aside, np.cross(axis, aside), axis])
    return np.asarray(_cylinder(radius, length) @ frame + np.array(start), dtype=np.float32)
