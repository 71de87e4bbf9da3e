"""Buildings of a few styles; local frame: x along the street, the facade at y = 0, the building behind it at y < 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from depthprint.simulation.meshes import Triangles, box, gable_roof, merge, moved

__all__ = ["STYLES", "BlockStyle", "building", "draw_style", "garage"]

Range = tuple[float, float]


@dataclass(frozen=True)
class BlockStyle:
    """How one side of a street is built; lengths in metres, ``*_share`` in 0..1.

    A side draws its own values from a style's ranges once, and its buildings vary about them by ``variety``, so
    that a street is like itself and, now and then, like another.
    """

    name: str
    width: Range
    depth: Range
    eaves: Range
    gap: Range
    garden: Range
    variety: float
    pitched_share: float
    bay_share: float
    balcony_share: float
    front_share: float
    tree_spacing: Range
    empty_share: float = 0.0


STYLES: dict[str, BlockStyle] = {
    style.name: style
    for style in (
        BlockStyle(
            "terrace", (5.5, 7.5), (8, 11), (5.5, 6.5), (0, 0), (2, 4), 0.04, 1.0, 0.6, 0.0, 0.8, (14, 30)
        ),
        BlockStyle(
            "detached", (9, 14), (8, 12), (3.2, 6), (3.5, 8), (4, 8), 0.2, 0.95, 0.35, 0.15, 0.9, (7, 16), 0.1
        ),
        BlockStyle(
            "townhouse", (7, 13), (9, 13), (7, 13), (0, 0), (0, 0.6), 0.25, 0.7, 0.3, 0.3, 0.0, (20, 45), 0.04
        ),
        BlockStyle(
            "apartments", (17, 34), (11, 14), (10, 19), (2, 14), (1, 6), 0.12, 0.2, 0.1, 0.9, 0.5, (9, 22)
        ),
        BlockStyle(
            "hall", (22, 45), (15, 25), (4.5, 8), (4, 16), (4, 11), 0.2, 0.35, 0.1, 0.0, 0.7, (18, 40), 0.1
        ),
        BlockStyle(
            "park", (8, 14), (7, 10), (3, 5), (20, 60), (14, 30), 0.2, 0.8, 0.1, 0.0, 0.7, (4, 9), 0.5
        ),
    )
}
_WEIGHTS = {
    "terrace": 0.24,
    "detached": 0.3,
    "townhouse": 0.16,
    "apartments": 0.12,
    "hall": 0.07,
    "park": 0.11,
}


def draw_style(rng: np.random.Generator) -> BlockStyle:
    """One side's own style: a narrow draw from the ranges of a style picked by its weight."""
    base = STYLES[str(rng.choice(list(_WEIGHTS), p=list(_WEIGHTS.values())))]

    def narrow(limits: Range) -> Range:
        middle, half = rng.uniform(*limits), 0.12 * (limits[1] - limits[0])
        return max(limits[0], middle - half), min(limits[1], middle + half)

    def sharper(share: float) -> float:
        return float(np.clip(share + rng.normal(0, 0.25), 0, 1))

    return BlockStyle(
        base.name, narrow(base.width), narrow(base.depth), narrow(base.eaves), narrow(base.gap),
        narrow(base.garden), base.variety, sharper(base.pitched_share), sharper(base.bay_share),
        sharper(base.balcony_share), sharper(base.front_share), narrow(base.tree_spacing), base.empty_share,
    )  # fmt: skip


def building(
    style: BlockStyle, width: float, depth: float, eaves: float, rng: np.random.Generator
) -> Triangles:
    """A building with its facade on y = 0, centred on x; what stands out of the facade stays within 1.3 m of it."""
    parts = [_body(style, width, depth, eaves, rng)]
    half = width / 2
    if rng.random() < style.pitched_share:
        rise = float(np.clip(rng.normal(0.36, 0.06), 0.2, 0.5)) * depth
        hip = depth / 2 if rng.random() < 0.25 else 0.0
        along = rng.random() < 0.8 or width > 1.4 * depth
        length, span, turn = (width, depth, 0.0) if along else (depth, width, np.pi / 2)
        parts.append(moved(gable_roof(length, span, eaves, rise, 0.15, hip), 0.0, -depth / 2, turn))
        if rng.random() < 0.4 and along and hip == 0:
            at = rng.uniform(-0.3, 0.3) * width
            parts.append(box(at - 0.9, at + 0.9, -0.45 * depth, -0.08 * depth, eaves, eaves + 0.75 * rise))
    elif rng.random() < 0.5:
        parts.append(box(-0.3 * half, 0.2 * half, -0.8 * depth, -0.4 * depth, eaves, eaves + 2.2))
    if rng.random() < 0.5:
        at = rng.uniform(-0.4, 0.4) * width
        parts.append(box(at, at + 0.7, -0.6 * depth, -0.6 * depth + 0.7, eaves, eaves + 0.42 * depth))
    if rng.random() < style.bay_share:
        at, reach, bay = rng.uniform(-0.3, 0.1) * width, rng.uniform(0.5, 1.2), rng.uniform(1.6, 2.8)
        at = min(at, half - bay)
        top = eaves if rng.random() < 0.3 else min(eaves, 3.0)
        parts.append(box(at, at + bay, 0, reach, 0, top))
    parts += _balconies(style, width, eaves, rng)
    return merge(parts)


def garage(width: float, depth: float, height: float) -> Triangles:
    """A low flat box with its front on y = 0."""
    return box(-width / 2, width / 2, -depth, 0, 0, height)


def _body(style: BlockStyle, width: float, depth: float, eaves: float, rng: np.random.Generator) -> Triangles:
    half = width / 2
    if width > 9 and rng.random() < 0.35:
        inset, split = rng.uniform(1.0, 3.5), rng.uniform(-0.2, 0.3) * width
        return merge([box(-half, split, -depth, 0, 0, eaves), box(split, half, -depth, -inset, 0, eaves)])
    door = rng.uniform(-0.35, 0.2) * width
    if style.name in ("townhouse", "apartments") and rng.random() < 0.6:
        entry = min(2.6, 0.25 * width)
        return merge(
            [
                box(-half, door, -depth, 0, 0, eaves),
                box(door, door + entry, -depth, -1.4, 0, 2.7),
                box(door, door + entry, -depth, 0, 2.7, eaves),
                box(door + entry, half, -depth, 0, 0, eaves),
            ]
        )
    parts = [box(-half, half, -depth, 0, 0, eaves)]
    if rng.random() < 0.4:
        parts.append(box(door, door + 1.8, 0, 1.1, 2.3, 2.5))
    return merge(parts)


def _balconies(style: BlockStyle, width: float, eaves: float, rng: np.random.Generator) -> list[Triangles]:
    if eaves < 5.5 or rng.random() >= style.balcony_share:
        return []
    pitch, length, reach = rng.uniform(4.5, 7.5), rng.uniform(2.2, 3.8), rng.uniform(0.8, 1.3)
    columns = np.arange(-width / 2 + 1.0, width / 2 - length - 0.5, pitch).tolist()
    floors = np.arange(2.8, eaves - 2.0, 2.9).tolist()
    return [
        part
        for x in columns
        for z in floors
        for part in (
            box(x, x + length, 0, reach, z, z + 0.15),
            box(x, x + length, reach - 0.08, reach, z + 0.15, z + 1.05),
        )
    ]
