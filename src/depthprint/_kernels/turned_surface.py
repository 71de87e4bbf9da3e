"""Rendering of the surface that neighbouring pixels of a depth image span, seen from elsewhere."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["draw_surface"]


@numba.njit(cache=True)
def draw_surface(
    u: npt.NDArray[np.float64],
    v: npt.NDArray[np.float64],
    z_m: npt.NDArray[np.float64],
    before_m: npt.NDArray[np.float64],
    largest_step: float,
    image: npt.NDArray[np.float32],
) -> None:
    """Draw pixels (h, w), now at columns ``u``, rows ``v`` and depths ``z_m``, into ``image`` (height, width).

    Two triangles a square of four pixels, their depth as planes have it; none over a step of more than
    ``largest_step`` of the depths ``before_m`` that pixels had (NaN: no return), and none that shows its back. The
    nearest stays. A pixel of no triangle is not drawn, being a stray return more often than a thing so thin.
    """
    rows, columns = z_m.shape
    for a in range(rows - 1):
        for b in range(columns - 1):
            for half in range(2):
                # Corners in the order in which a front shows them: clockwise, as rows grow downwards.
                a0, b0 = a + half, b + half
                a1, b1 = (a, b + 1) if half == 0 else (a + 1, b)
                a2, b2 = (a + 1, b) if half == 0 else (a, b + 1)
                first, second, third = before_m[a0, b0], before_m[a1, b1], before_m[a2, b2]
                low, high = min(first, second, third), max(first, second, third)
                if not (first == first and second == second and third == third):
                    continue
                if high - low > largest_step * low:
                    continue
                _draw_triangle(
                    u[a0, b0], v[a0, b0], z_m[a0, b0],
                    u[a1, b1], v[a1, b1], z_m[a1, b1],
                    u[a2, b2], v[a2, b2], z_m[a2, b2],
                    image,
                )  # fmt: skip


@numba.njit(cache=True)
def _draw_triangle(
    u0: float, v0: float, z0: float,
    u1: float, v1: float, z1: float,
    u2: float, v2: float, z2: float,
    image: npt.NDArray[np.float32],
) -> None:  # fmt: skip
    area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
    if not (area > 1e-9 and min(z0, z1, z2) > 0.0):
        return
    height, width = image.shape
    top = max(0, math.ceil(min(v0, v1, v2) - 1e-6))
    bottom = min(height - 1, math.floor(max(v0, v1, v2) + 1e-6))
    left = max(0, math.ceil(min(u0, u1, u2) - 1e-6))
    right = min(width - 1, math.floor(max(u0, u1, u2) + 1e-6))
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            w0 = ((u1 - column) * (v2 - row) - (u2 - column) * (v1 - row)) / area
            w1 = ((u2 - column) * (v0 - row) - (u0 - column) * (v2 - row)) / area
            w2 = 1.0 - w0 - w1
            if w0 < -1e-6 or w1 < -1e-6 or w2 < -1e-6:
                continue
            # On a plane one over the depth is linear in the image.
            value = np.float32(1.0 / (w0 / z0 + w1 / z1 + w2 / z2))
            if not image[row, column] <= value:
                image[row, column] = value
