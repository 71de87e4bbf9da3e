"""Small hand-made range images for tests: a wall, boxes in front of it, some holes."""

from __future__ import annotations

import numpy as np

from depthprint.projection import LaserRow, Pinhole, Projection
from depthprint.range_image import RangeImage

CAMERA = Pinhole(fx=80.0, fy=80.0, cx=63.5, cy=47.5, width=128, height=96)


def boxes(
    seed: int, projection: Projection = CAMERA, *, height_m: float | None = 1.5, shift: int = 0
) -> RangeImage:
    """A wall with boxes at random places; equal seeds give equal scenes, ``shift`` moves them sideways in pixels."""
    rng = np.random.default_rng(seed)
    h, w = projection.height, projection.width
    depth = np.full((h, w), 12.0) + np.linspace(0, 2, w)
    for _ in range(8):
        x, width = int(rng.integers(0, w - 10)), int(rng.integers(5, max(6, w // 4)))
        y, tall = int(rng.integers(0, max(1, h // 2))), int(rng.integers(max(1, h // 4), h + 1))
        left = max(0, x + shift)
        depth[y : y + tall, left : max(left, x + width + shift)] = rng.uniform(2, 10)
    depth[rng.random((h, w)) < 0.03] = np.nan
    return RangeImage(depth.astype(np.float32), projection, sensor_height_m=height_m, source=f"boxes {seed}")


def scan(seed: int, *, beams: int = 180) -> RangeImage:
    """One row of a planar scanner."""
    return boxes(seed, LaserRow(beams, -np.pi / 2, np.pi / beams), height_m=0.4)


def crop(seed: int) -> RangeImage:
    """A masked crop of a bump on a table."""
    rng = np.random.default_rng(seed)
    yy, xx = np.mgrid[-1:1:60j, -1:1:50j]
    radius = np.hypot(xx / rng.uniform(0.5, 0.9), yy / rng.uniform(0.5, 0.9))
    mask = radius < 1
    bump = 0.1 * np.sqrt(np.clip(1 - radius ** rng.uniform(1, 3), 0, 1)) + 0.02 * np.sin(
        8 * rng.random() * xx
    )
    depth = 1.0 - np.where(mask, bump, 0.0)
    camera = Pinhole(fx=575.8, fy=575.8, cx=30.0, cy=20.0, width=50, height=60)
    return RangeImage(depth.astype(np.float32), camera, mask=mask, source=f"crop {seed}")
