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
Int64 = npt.NDArray[np.int64]

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


@njit(cache=True, nogil=True, error_model="numpy")
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
    few, many = _columns(query, coarse[0]), _columns(query, 1)
    few_back, many_back = _columns(stored, coarse[0]), _columns(stored, 1)
    moved = np.empty((8, max(many.shape[1], many_back.shape[1])))
    rows = np.empty((2 * many.shape[1] + 2, 8))
    sides = np.empty((2, many.shape[1] + 1), dtype=np.int64)
    trial, back = np.eye(4), np.eye(4)
    best = -math.inf
    for number in range(len(starts)):
        for a in range(3):
            for b in range(3):
                trial[a, b] = starts[number, a, b]
            trial[a, 3] = stored.middle[a]
        _refine(few, stored, coarse[1], 0.5, 0.1, trial, moved, rows, sides)
        agreement = _both_ways(few, few_back, query, stored, noise, trial, back, moved)
        if agreement > best:
            best = agreement
            pose[:] = trial
    _refine(many, stored, fine, 0.2, 0.1, pose, moved, rows, sides)
    return float(_both_ways(many, many_back, query, stored, noise, pose, back, moved))


@njit(cache=True, nogil=True, error_model="numpy")
def _columns(surface: SeenSurface, step: int) -> Float64:
    """Every ``step``-th point and its normal, (6, n)."""
    n = (len(surface.points) + step - 1) // step
    columns = np.empty((6, n))
    for k in range(n):
        for axis in range(3):
            columns[axis, k] = surface.points[k * step, axis]
            columns[3 + axis, k] = surface.normals[k * step, axis]
    return columns


@njit(cache=True, nogil=True, error_model="numpy")
def _both_ways(
    points: Float64,
    points_back: Float64,
    query: SeenSurface,
    stored: SeenSurface,
    noise: float,
    pose: Float64,
    back: Float64,
    moved: Float64,
) -> float:
    forth, _, through = _shares(points, stored, noise, True, pose, moved)
    # The inverse, about the stored surface's middle.
    for a in range(3):
        back[a, 3] = query.middle[a]
        for b in range(3):
            back[a, b] = pose[b, a]
    for a in range(3):
        for b in range(3):
            back[a, 3] += back[a, b] * (stored.middle[b] - pose[b, 3])
    returned, _, seen_through = _shares(points_back, query, noise, False, back, moved)
    return 0.5 * float(forth - through + returned - seen_through)


@njit(cache=True, nogil=True, error_model="numpy")
def surface_shares(
    surface: SeenSurface, seen: SeenSurface, step: int, noise: float, whole: bool, pose: Float64
) -> tuple[float, float, float]:
    """Shares of a surface's points that another view confirms with their normals, confirms at all, and sees through.

    Every ``step``-th point is asked, moved by pose (4, 4) T_seen_surface about its middle. A pixel around a point
    confirms it by 1 - (e / 2 noise)^2, times the cosine between the normals; it is seen through where all pixels around
    see further, and, where ``whole`` says that the crop holds the whole object, beside the crop. What is turned away,
    lies behind something or where nothing is known says neither.
    """
    points = _columns(surface, step)
    shares: tuple[float, float, float] = _shares(
        points, seen, noise, whole, pose, np.empty((8, points.shape[1]))
    )
    return shares


@njit(cache=True, nogil=True, error_model="numpy")
def _shares(
    points: Float64, seen: SeenSurface, noise: float, whole: bool, pose: Float64, moved: Float64
) -> tuple[float, float, float]:
    height, width = seen.depths.shape
    confirmed = alike = through = 0.0
    n = points.shape[1]
    _move(points, pose, seen.lens, moved)
    for k in range(n):
        x, y, z, nx, ny, nz = moved[0, k], moved[1, k], moved[2, k], moved[3, k], moved[4, k], moved[5, k]
        if z <= 0.0 or -(nx * x + ny * y + nz * z) < _LEAST_FACING * math.sqrt(x * x + y * y + z * z):
            continue
        u, v = moved[6, k], moved[7, k]
        if not ((u >= 0.0) & (v >= 0.0) & (u < width) & (v < height)):
            through += whole
            continue
        row, column = int(v), int(u)
        closest, partner, further = _around(seen, row, column, z, 2.0 * noise)
        if closest < 2.0 * noise:
            share = 1.0 - (0.5 * closest / noise) ** 2
            slope = seen.slopes[partner // width, partner % width]
            alike += share
            confirmed += share * max(0.0, slope[0] * nx + slope[1] * ny + slope[2] * nz)
        elif further and seen.kinds[row, column] != UNKNOWN:
            through += 1.0
    return confirmed / n, alike / n, through / n


@njit(cache=True, nogil=True, error_model="numpy")
def _around(seen: SeenSurface, row: int, column: int, z: float, reach: float) -> tuple[float, int, bool]:
    """Of the pixels around one: how near to depth z the object's nearest is, its number, and whether all lie beyond.

    No branches on what the pixels hold, which no processor foresees; depths are NaN where nothing is known.
    """
    height, width = seen.depths.shape
    closest, at, further = math.inf, 0, True
    for i in range(max(row - 1, 0), min(row + 2, height)):
        for j in range(max(column - 1, 0), min(column + 2, width)):
            gap = np.float64(seen.depths[i, j]) - z
            further = further & (not gap < reach)
            nearer = (seen.kinds[i, j] == OBJECT) & (abs(gap) < closest)
            closest = abs(gap) if nearer else closest
            at = i * width + j if nearer else at
    return closest, at, further


@njit(cache=True, nogil=True, error_model="numpy")
def _move(points: Float64, pose: Float64, lens: Float64, moved: Float64) -> None:
    """Fill moved (8, n) with points and normals (6, n) in another frame, and column and row of their pixels there.

    One loop without branches (hence numpy's division), which compilers do for several points at once. Pixels are
    whole numbers in floating point; where z is not positive they mean nothing.
    """
    p00, p01, p02, p03 = pose[0, 0], pose[0, 1], pose[0, 2], pose[0, 3]
    p10, p11, p12, p13 = pose[1, 0], pose[1, 1], pose[1, 2], pose[1, 3]
    p20, p21, p22, p23 = pose[2, 0], pose[2, 1], pose[2, 2], pose[2, 3]
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    for k in range(points.shape[1]):
        a, b, c = points[0, k], points[1, k], points[2, k]
        u, v, w = points[3, k], points[4, k], points[5, k]
        x = p00 * a + p01 * b + p02 * c + p03
        y = p10 * a + p11 * b + p12 * c + p13
        z = p20 * a + p21 * b + p22 * c + p23
        moved[0, k], moved[1, k], moved[2, k] = x, y, z
        moved[3, k] = p00 * u + p01 * v + p02 * w
        moved[4, k] = p10 * u + p11 * v + p12 * w
        moved[5, k] = p20 * u + p21 * v + p22 * w
        moved[6, k] = np.floor(fx * x / z + cx + 0.5)
        moved[7, k] = np.floor(fy * y / z + cy + 0.5)


@njit(cache=True, nogil=True, error_model="numpy")
def _refine(
    points: Float64,
    stored: SeenSurface,
    times: int,
    wide: float,
    narrow: float,
    pose: Float64,
    moved: Float64,
    rows: Float64,
    sides: Int64,
) -> None:
    """Gauss-Newton on distances to the planes of the pixels that points fall on, Tukey's weights narrowing.

    Points beside the object are drawn, in the image plane, to its nearest pixel. wide, narrow: first and last reach of
    the weights, as shares of the stored surface's size.
    """
    hessian, gradient, change = np.empty((6, 6)), np.empty(6), np.empty(6)
    rotation, room, middle = np.empty((3, 3)), np.empty((3, 4)), np.empty(3)
    asked = points.shape[1]
    for time in range(times):
        reach = stored.size * wide * (narrow / wide) ** (time / max(1, times - 1))
        _move(points, pose, stored.lens, moved)
        n = _linearised(moved, asked, stored, pose, reach, rows, sides)
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


@njit(cache=True, nogil=True, error_model="numpy")
def _linearised(
    moved: Float64, asked: int, stored: SeenSurface, pose: Float64, reach: float, rows: Float64, sides: Int64
) -> int:
    """Fill rows (n, 8): slope of the error (6,), error, weight; how many. Points beside the object have two.

    Points are told apart first, and then each kind in a loop of its own; they and rows are kept by counting them, not
    by branches that no processor foresees. sides (2, asked): room for the numbers of the points on and beside.
    """
    height, width = stored.depths.shape
    fx, fy, cx, cy = stored.lens[0], stored.lens[1], stored.lens[2], stored.lens[3]
    # Turns are about the middle of the query.
    tx, ty, tz = pose[0, 3], pose[1, 3], pose[2, 3]
    on = beside = 0
    for k in range(asked):
        z, u, v = moved[2, k], moved[6, k], moved[7, k]
        seen = (z > 0.0) & (moved[3, k] * moved[0, k] + moved[4, k] * moved[1, k] + moved[5, k] * z <= 0.0)
        inside = (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height)
        row, column = min(max(int(v), 0), height - 1), min(max(int(u), 0), width - 1)
        inside &= stored.kinds[row, column] == OBJECT
        sides[0, on] = sides[1, beside] = k
        on += seen & inside
        beside += seen & (not inside)
    n = 0
    for place in range(on):
        k = sides[0, place]
        x, y, z, u, v = moved[0, k], moved[1, k], moved[2, k], moved[6, k], moved[7, k]
        there = np.float64(stored.depths[int(v), int(u)])
        slope = stored.slopes[int(v), int(u)]
        mx, my, mz = np.float64(slope[0]), np.float64(slope[1]), np.float64(slope[2])
        error = mx * ((u - cx) / fx * there - x) + my * ((v - cy) / fy * there - y) + mz * (there - z)
        likeness = mx * moved[3, k] + my * moved[4, k] + mz * moved[5, k]
        x, y, z = x - tx, y - ty, z - tz
        part = rows[n]
        part[0], part[1], part[2] = y * mz - z * my, z * mx - x * mz, x * my - y * mx
        part[3], part[4], part[5] = mx, my, mz
        part[6], part[7] = error, likeness * (1.0 - (error / reach) ** 2) ** 2
        n += (likeness >= _LEAST_PARTNER) & (abs(error) <= reach)
    for place in range(beside):
        k = sides[1, place]
        x, y, z = moved[0, k], moved[1, k], moved[2, k]
        row, column = min(max(int(moved[7, k]), 0), height - 1), min(max(int(moved[6, k]), 0), width - 1)
        pixel = stored.nearest[row, column]
        row, column = pixel // width, pixel % width
        there = np.float64(stored.depths[row, column])
        dx, dy, dz = (column - cx) / fx * there - x, (row - cy) / fy * there - y, there - z
        x, y, z = x - tx, y - ty, z - tz
        part = rows[n]
        part[0], part[1], part[2], part[3], part[4], part[5] = 0.0, z, -y, 1.0, 0.0, 0.0
        part[6], part[7] = dx, _BESIDE
        part = rows[n + 1]
        part[0], part[1], part[2], part[3], part[4], part[5] = -z, 0.0, x, 0.0, 1.0, 0.0
        part[6], part[7] = dy, _BESIDE
        n += 2 * (dx * dx + dy * dy + dz * dz <= 4.0 * reach * reach)
    return n
