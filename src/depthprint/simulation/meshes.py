"""Solid shapes as triangle soups: (n, 3, 3) float32 corners in metres, z up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

__all__ = ["Triangles", "box", "ellipsoid", "gable_roof", "hexahedron", "lathe", "merge", "moved"]

Triangles = npt.NDArray[np.float32]
Rectangle = tuple[float, float, float, float]

_HEXAHEDRON_FACES = np.array(
    [
        (0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4),
        (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7),
    ]
)  # fmt: skip


def merge(parts: Sequence[Triangles]) -> Triangles:
    """One soup of several; (0, 3, 3) of none."""
    if not parts:
        return np.zeros((0, 3, 3), np.float32)
    return np.concatenate(parts, dtype=np.float32)


def moved(triangles: Triangles, x: float, y: float, heading_rad: float = 0.0, z: float = 0.0) -> Triangles:
    """The soup turned about the z axis by ``heading_rad``, then shifted by (x, y, z) metres."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    rotation = np.array([(c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)])
    return np.asarray(triangles @ rotation + np.array([x, y, z]), dtype=np.float32)


def hexahedron(bottom: Rectangle, top: Rectangle, z_bottom: float, z_top: float) -> Triangles:
    """Solid between two axis-parallel rectangles (x_min, x_max, y_min, y_max) at two heights: 12 triangles."""
    corners = []
    for (x0, x1, y0, y1), z in ((bottom, z_bottom), (top, z_top)):
        corners += [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
    return np.asarray(np.array(corners, dtype=np.float32)[_HEXAHEDRON_FACES])


def box(x_min: float, x_max: float, y_min: float, y_max: float, z_min: float, z_max: float) -> Triangles:
    """Axis-parallel box: 12 triangles."""
    return hexahedron((x_min, x_max, y_min, y_max), (x_min, x_max, y_min, y_max), z_min, z_max)


def gable_roof(
    length: float, width: float, z_eaves: float, rise: float, overhang: float = 0.3, hip: float = 0.0
) -> Triangles:
    """Roof with its ridge along x over a centred length x width rectangle; ``hip`` shortens the ridge at both ends."""
    a, b = length / 2 + overhang, width / 2 + overhang
    ridge = max(a - hip, 0.0)
    return hexahedron((-a, a, -b, b), (-ridge, ridge, 0.0, 0.0), z_eaves, z_eaves + rise)


def lathe(profile: Sequence[tuple[float, float]], sides: int = 8) -> Triangles:
    """Surface of revolution about z through (radius, z) points: 2 sides (points - 1) triangles."""
    angles = np.arange(sides + 1) * (2 * math.pi / sides)
    radius, height = np.array(profile, dtype=float).T
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = np.concatenate(
        [
            radius[:, None, None] * ring[None],
            np.broadcast_to(height[:, None, None], (len(radius), sides + 1, 1)),
        ],
        axis=2,
    )
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    lower = np.stack([a, b, c], axis=2).reshape(-1, 3, 3)
    upper = np.stack([a, c, d], axis=2).reshape(-1, 3, 3)
    return np.asarray(np.concatenate([lower, upper]), dtype=np.float32)


def ellipsoid(
    radii: tuple[float, float, float],
    centre: tuple[float, float, float],
    lumps: npt.NDArray[np.float64] | None = None,
    sides: int = 9,
) -> Triangles:
    """Ellipsoid of six rings; ``lumps`` (6,) scales the rings' radii, to make a crown uneven."""
    polar = np.linspace(0, math.pi, 6)
    ring = np.sin(polar) * (1.0 if lumps is None else lumps)
    ring[[0, -1]] = 0.0
    unit = lathe(list(zip(ring.tolist(), (-np.cos(polar)).tolist(), strict=True)), sides)
    return np.asarray(unit * np.array(radii) + np.array(centre), dtype=np.float32)
