"""What stands along a street besides buildings: trees, bushes, poles, signs, hedges, walls and fences."""

from __future__ import annotations

import numpy as np

from depthprint.simulation.meshes import Triangles, box, ellipsoid, lathe, merge

__all__ = ["BUSH_SPREAD", "barrier", "bush", "pole", "sign", "tree"]

BUSH_SPREAD = 1.1


def tree(height: float, crown_radius: float, shape: str, rng: np.random.Generator) -> Triangles:
    """Tree at the origin; ``shape`` is 'round', 'cone' or 'column'; low branches begin above 2.3 m, cones lower."""
    trunk_radius = 0.035 * height * rng.uniform(0.7, 1.2) + 0.05
    if shape == "cone":
        base = 0.08 * height
        crown = lathe(
            [
                (0.3, base),
                (crown_radius, base + 0.06 * height),
                (0.45 * crown_radius, 0.6 * height),
                (0.0, height),
            ]
        )
        return merge([_trunk(trunk_radius, base + 0.3), crown])
    base = max(2.3, rng.uniform(0.28, 0.4) * height)
    middle, half = (base + height) / 2, (height - base) / 2
    stretch = 1.0 if shape == "round" else 0.5
    parts = [_trunk(trunk_radius, base + 0.5 * half)]
    radius = crown_radius * stretch
    parts.append(ellipsoid((radius, radius, half), (0.0, 0.0, middle), rng.uniform(0.75, 1.1, 6), sides=8))
    for _ in range(int(rng.integers(0, 3)) if shape == "round" else 0):
        lump, angle = rng.uniform(0.4, 0.6) * radius, rng.uniform(0, 2 * np.pi)
        reach = 0.6 * (radius - lump) + 0.2 * radius
        centre = (reach * np.cos(angle), reach * np.sin(angle), middle + rng.uniform(-0.3, 0.3) * half)
        parts.append(ellipsoid((lump, lump, 0.9 * lump), centre, rng.uniform(0.8, 1.1, 6), sides=7))
    return merge(parts)


def bush(radius: float, height: float, rng: np.random.Generator) -> Triangles:
    """A lump on the ground at the origin, within ``BUSH_SPREAD`` times ``radius``."""
    return ellipsoid(
        (radius, radius, 0.62 * height), (0.0, 0.0, 0.38 * height), rng.uniform(0.8, BUSH_SPREAD, 6), sides=8
    )


def pole(height: float, arm: float = 0.0) -> Triangles:
    """Lamp post at the origin; ``arm`` metres of outreach towards +y at its top."""
    parts = [lathe([(0.09, 0.0), (0.07, height), (0.0, height)], sides=6)]
    if arm > 0:
        parts.append(box(-0.08, 0.08, 0.0, arm, height - 0.15, height))
    return merge(parts)


def sign(height: float, width: float) -> Triangles:
    """A plate across the street on a thin post, or a cabinet where it is low."""
    if height < 1.6:
        return box(-width / 2, width / 2, -0.2, 0.2, 0.0, height)
    post = lathe([(0.04, 0.0), (0.04, height)], sides=5)
    return merge([post, box(-0.02, 0.02, -width / 2, width / 2, height - width, height)])


def barrier(length: float, height: float, thickness: float) -> Triangles:
    """A straight run of hedge, wall or fence along x, centred on the origin."""
    return box(-length / 2, length / 2, -thickness / 2, thickness / 2, 0.0, height)


def _trunk(radius: float, height: float) -> Triangles:
    return lathe([(radius, 0.0), (0.8 * radius, height)], sides=6)
