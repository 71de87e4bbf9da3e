"""Alignment of the surfaces that two depth crops of objects show, and how far both agree where they are laid."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.projective_icp import move_pose, normal_equations, solve_step

__all__ = ["BACKGROUND", "OBJECT", "UNKNOWN", "SeenSurface", "align_surfaces", "surface_shares"]

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]

UNKNOWN, OBJECT, BACKGROUND = 0, 1, 2

# Weight of a pixel's offset in the image plane for points beside the object, and what holds a pose where it is.
_BESIDE = 0.1
_TURN_DAMPING = 0.02
_SHIFT_DAMPING = 0.002
# Cosines: of surfaces that may be partners, and of a surface that its camera still sees.
_LEAST_PARTNER = 0.2
_LEAST_FACING = 0.1


class SeenSurface(NamedTuple):
    """What a crop shows of an object; all arrays are read-only.

    points, normals (n, 3): some of its pixels' points about ``middle`` (3,), metres. size: their root mean square
    distance from it. Of every pixel (h, w): depths in metres (object or background, NaN for neither), kinds (UNKNOWN,
    OBJECT, BACKGROUND), nearest (flat number of the nearest pixel of the object), slopes (h, w, 3; normals of the
    object's). lens (4,): focal lengths and centre.
    """

    points: Float32
    normals: Float32
    middle: Float64
    size: float
    depths: Float32
    kinds: npt.NDArray[np.int8]
    nearest: npt.NDArray[np.int32]
    slopes: Float32
    lens: Float64


@njit(cache=True, nogil=True)
def align_surfaces(
    query: SeenSurface,
    stored: SeenSurface,
    starts: Float64,
    coarse: tuple[int, int],
    fine: int,
    noise: float,
    pose: Float64,
) -> float:
    """Agreement of the query with a stored surface in the best alignment found; its pose is filled.

    The query's middle, turned by each of starts (s, 3, 3), is laid on the stored one's and refined with every
    coarse[0]-th point, coarse[1] times; the start that agrees best then with all points, ``fine`` times. pose (4, 4):
    T_stored_query about the query's middle, in the stored camera's frame. noise: metres. Agreement: as
    ``surface_shares`` has it, mean of both ways.
    """
    trial, back = np.eye(4), np.eye(4)
    best = -math.inf
    for number in range(len(starts)):
        for a in range(3):
            for b in range(3):
                trial[a, b] = starts[number, a, b]
            trial[a, 3] = stored.middle[a]
        _refine(query, stored, coarse[0], coarse[1], 0.5, 0.1, trial)
        agreement = _both_ways(query, stored, coarse[0], noise, trial, back)
        if agreement > best:
            best = agreement
            pose[:] = trial
    _refine(query, stored, 1, fine, 0.2, 0.1, pose)
    return float(_both_ways(query, stored, 1, noise, pose, back))


@njit(cache=True, nogil=True)
def _both_ways(
    query: SeenSurface, stored: SeenSurface, step: int, noise: float, pose: Float64, back: Float64
) -> float:
    forth, _, through = surface_shares(query, stored, step, noise, True, pose)
    # The inverse, about the stored surface's middle.
    for a in range(3):
        back[a, 3] = query.middle[a]
        for b in range(3):
            back[a, b] = pose[b, a]
    for a in range(3):
        for b in range(3):
            back[a, 3] += back[a, b] * (stored.middle[b] - pose[b, 3])
    returned, _, seen_through = surface_shares(stored, query, step, noise, False, back)
    return 0.5 * float(forth - through + returned - seen_through)


@njit(cache=True, nogil=True)
def surface_shares(
    surface: SeenSurface, seen: SeenSurface, step: int, noise: float, whole: bool, pose: Float64
) -> tuple[float, float, float]:
    """Shares of a surface's points that another view confirms with their normals, confirms at all, and sees through.

    Every ``step``-th point is asked, moved by pose (4, 4) T_seen_surface about its middle. A pixel around a point
    confirms it by 1 - (e / 2 noise)^2, times the cosine between the normals; it is seen through where all pixels around
    see further, and, where ``whole`` says that the crop holds the whole object, beside the crop. What is turned away,
    lies behind something or where nothing is known says neither.
    """
    height, width = seen.depths.shape
    fx, fy, cx, cy = seen.lens[0], seen.lens[1], seen.lens[2], seen.lens[3]
    confirmed = alike = through = 0.0
    n = 0
    for k in range(0, len(surface.points), step):
        n += 1
        x, y, z, nx, ny, nz = _moved(surface, k, pose)
        if z <= 0.0 or -(nx * x + ny * y + nz * z) < _LEAST_FACING * math.sqrt(x * x + y * y + z * z):
            continue
        column, row = math.floor(fx * x / z + cx + 0.5), math.floor(fy * y / z + cy + 0.5)
        if column < 0 or row < 0 or column >= width or row >= height:
            through += whole
            continue
        closest, partner_row, partner_column, further = math.inf, -1, -1, True
        for i in range(max(row - 1, 0), min(row + 2, height)):
            for j in range(max(column - 1, 0), min(column + 2, width)):
                kind = seen.kinds[i, j]
                if kind == UNKNOWN:
                    continue
                gap = np.float64(seen.depths[i, j]) - z
                further = further and gap >= 2.0 * noise
                if kind == OBJECT and abs(gap) < closest:
                    closest, partner_row, partner_column = abs(gap), i, j
        if closest < 2.0 * noise:
            share = 1.0 - (0.5 * closest / noise) ** 2
            slope = seen.slopes[partner_row, partner_column]
            alike += share
            confirmed += share * max(0.0, slope[0] * nx + slope[1] * ny + slope[2] * nz)
        elif further and seen.kinds[row, column] != UNKNOWN:
            through += 1.0
    return confirmed / n, alike / n, through / n


@njit(cache=True, nogil=True)
def _moved(surface: SeenSurface, k: int, pose: Float64) -> tuple[float, float, float, float, float, float]:
    """A point and its normal in another frame."""
    a, b, c = (
        np.float64(surface.points[k, 0]),
        np.float64(surface.points[k, 1]),
        np.float64(surface.points[k, 2]),
    )
    u, v, w = (
        np.float64(surface.normals[k, 0]),
        np.float64(surface.normals[k, 1]),
        np.float64(surface.normals[k, 2]),
    )
    return (
        pose[0, 0] * a + pose[0, 1] * b + pose[0, 2] * c + pose[0, 3],
        pose[1, 0] * a + pose[1, 1] * b + pose[1, 2] * c + pose[1, 3],
        pose[2, 0] * a + pose[2, 1] * b + pose[2, 2] * c + pose[2, 3],
        pose[0, 0] * u + pose[0, 1] * v + pose[0, 2] * w,
        pose[1, 0] * u + pose[1, 1] * v + pose[1, 2] * w,
        pose[2, 0] * u + pose[2, 1] * v + pose[2, 2] * w,
    )


@njit(cache=True, nogil=True)
def _refine(
    query: SeenSurface, stored: SeenSurface, step: int, times: int, wide: float, narrow: float, pose: Float64
) -> None:
    """Gauss-Newton on distances to the planes of the pixels that points fall on, Tukey's weights narrowing.

    Points beside the object are drawn, in the image plane, to its nearest pixel. wide, narrow: first and last reach of
    the weights, as shares of the stored surface's size.
    """
    height, width = stored.depths.shape
    fx, fy, cx, cy = stored.lens[0], stored.lens[1], stored.lens[2], stored.lens[3]
    hessian, gradient, change = np.empty((6, 6)), np.empty(6), np.empty(6)
    rotation, room, middle = np.empty((3, 3)), np.empty((3, 4)), np.empty(3)
    asked = (len(query.points) + step - 1) // step
    # Slope of the error (6,), error, weight; points beside the object have two rows.
    rows = np.empty((2 * asked, 8))
    for time in range(times):
        reach = stored.size * wide * (narrow / wide) ** (time / max(1, times - 1))
        n = 0
        for k in range(0, len(query.points), step):
            x, y, z, nx, ny, nz = _moved(query, k, pose)
            if z <= 0.0 or nx * x + ny * y + nz * z > 0.0:
                continue
            column, row = math.floor(fx * x / z + cx + 0.5), math.floor(fy * y / z + cy + 0.5)
            inside = 0 <= column < width and 0 <= row < height
            column, row = min(max(column, 0), width - 1), min(max(row, 0), height - 1)
            pixel = stored.nearest[row, column]
            inside = inside and stored.kinds[row, column] == OBJECT
            row, column = pixel // width, pixel % width
            there = np.float64(stored.depths[row, column])
            dx, dy, dz = (column - cx) / fx * there - x, (row - cy) / fy * there - y, there - z
            # Turns are about the middle of the query.
            x, y, z = x - pose[0, 3], y - pose[1, 3], z - pose[2, 3]
            if inside:
                mx = np.float64(stored.slopes[row, column, 0])
                my = np.float64(stored.slopes[row, column, 1])
                mz = np.float64(stored.slopes[row, column, 2])
                likeness = mx * nx + my * ny + mz * nz
                error = mx * dx + my * dy + mz * dz
                if likeness < _LEAST_PARTNER or abs(error) > reach:
                    continue
                part = rows[n]
                part[0], part[1], part[2] = y * mz - z * my, z * mx - x * mz, x * my - y * mx
                part[3], part[4], part[5] = mx, my, mz
                part[6], part[7] = error, likeness * (1.0 - (error / reach) ** 2) ** 2
                n += 1
            elif dx * dx + dy * dy + dz * dz <= 4.0 * reach * reach:
                part = rows[n]
                part[0], part[1], part[2], part[3], part[4], part[5] = 0.0, z, -y, 1.0, 0.0, 0.0
                part[6], part[7] = dx, _BESIDE
                part = rows[n + 1]
                part[0], part[1], part[2], part[3], part[4], part[5] = -z, 0.0, x, 0.0, 1.0, 0.0
                part[6], part[7] = dy, _BESIDE
                n += 2
        normal_equations(rows, n, hessian, gradient)
        for a in range(3):
            hessian[a, a] += _TURN_DAMPING * asked * stored.size * stored.size
            hessian[a + 3, a + 3] += _SHIFT_DAMPING * asked
        if not solve_step(hessian, gradient, change):
            break
        for a in range(3):
            middle[a], pose[a, 3] = pose[a, 3], 0.0
        move_pose(pose, change, rotation, room)
        for a in range(3):
            pose[a, 3] += middle[a]
