"""Simulated rooms: furnished, and seen by a depth camera that is carried through them by hand, twice."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.simulation.checks import require_whole
from depthprint.simulation.meshes import Triangles, box, ellipsoid, lathe, merge, moved

__all__ = ["simulated_rooms"]

FloatArray = npt.NDArray[np.float64]

CAMERA = Pinhole(fx=143.95, fy=143.95, cx=79.5, cy=59.5, width=160, height=120)
ROOM_SPACING_M = 20.0
# Nothing that stands this far from the walls reaches the height at which the camera is carried.
CAMERA_TO_WALL_M = 1.15
CAMERA_HEIGHTS_M = (1.05, 1.65)
FRAME_STEP_M, FRAME_STEP_RAD, STROLL_M = 0.03, math.radians(2.0), 0.8
_WORLD_STREAM, _PATH_STREAM, _NOISE_STREAM = 0, 1, 2


def simulated_rooms(n_frames: int = 300, seed: int = 0, n_rooms: int = 2) -> RangeSequence:
    """Furnished rooms seen by a hand-held depth camera (160 x 120 pixels, 58 degrees); all simulated.

    Each room is visited twice, the second time backwards and not quite along the same way, so that views
    come back. Within a visit the path is smooth in all six degrees of freedom, 1.05 to 1.65 m above the
    floor; between visits the camera is carried to the next room unseen. A visit has n_frames / (2 n_rooms)
    frames; visits of fewer than about 50 frames hurry.
    Ranges are z in metres with a Kinect's noise, steps and holes; frame i is the same whenever it is read.
    Poses are T_world_sensor of the camera (x right, y down, z forward) in a world whose z points up.
    Truth: view overlap, gap 50. Raises SettingsError for counts out of range.
    """
    require_whole("n_rooms", n_rooms, 1)
    require_whole("n_frames", n_frames, 2 * n_rooms)
    require_whole("seed", seed, 0)
    from depthprint.simulation.ray_casting import RayScene
    from depthprint.simulation.sensor_noise import kinect_noise

    triangles, poses = _world_and_path(n_frames, seed, n_rooms)
    scene = RayScene(triangles)
    name = f"simulated_rooms/seed{seed}"

    def read(index: int) -> RangeImage:
        rng = np.random.default_rng([seed, _NOISE_STREAM, index])
        ranges_m = kinect_noise(scene.cast(CAMERA, poses[index]), CAMERA, rng)
        return RangeImage(ranges_m, CAMERA, source=f"{name}, frame {index}")

    return RangeSequence(
        name=name,
        read=read,
        length=n_frames,
        preset="handheld",
        poses=poses,
        world_up=(0.0, 0.0, 1.0),
        truth=LoopTruth("overlap", gap=50, positive=0.5, negative=0.3),
        simulated=True,
    )


def _world_and_path(n_frames: int, seed: int, n_rooms: int) -> tuple[Triangles, FloatArray]:
    lap_m = [np.array_split(lap, n_rooms) for lap in np.array_split(np.arange(n_frames), 2)]
    poses = np.empty((n_frames, 4, 4))
    rooms = []
    for room in range(n_rooms):
        width_m, depth_m, furnished = _room(np.random.default_rng([seed, _WORLD_STREAM, room]))
        rooms.append(moved(furnished, room * ROOM_SPACING_M, 0.0))
        frames = np.concatenate([lap[room] for lap in lap_m])
        rng = np.random.default_rng([seed, _PATH_STREAM, room])
        free_m = np.array([width_m, depth_m]) / 2 - CAMERA_TO_WALL_M
        poses[frames] = _there_and_back(rng, len(frames), free_m)
        poses[frames, 0, 3] += room * ROOM_SPACING_M
    poses.setflags(write=False)
    return merge(rooms), poses


def _there_and_back(rng: np.random.Generator, n: int, free_m: FloatArray) -> FloatArray:
    """Poses (n, 4, 4) that wander over |x, y| <= free_m from viewpoint to viewpoint, and return."""
    from scipy.interpolate import PchipInterpolator

    low = np.array([-free_m[0], -free_m[1], CAMERA_HEIGHTS_M[0]])
    high = np.array([free_m[0], free_m[1], CAMERA_HEIGHTS_M[1]])
    views = [_viewpoint(rng, low, high, None)]
    times = [0.0]
    while times[-1] < n / 2 or len(views) < 3:
        views.append(_viewpoint(rng, low, high, views[-1]))
        times.append(times[-1] + _duration(views[-2], views[-1]))
    there = np.array(views)
    back = there[::-1] + rng.normal(0, [0.1, 0.1, 0.05, 0.06, 0.05, 0.03], there.shape)
    keys = np.concatenate([there, back])
    steps = np.concatenate([np.diff(times), [_duration(there[-1], back[0])], np.diff(times)[::-1]])
    clock = np.concatenate([[0.0], np.cumsum(steps)])
    states = PchipInterpolator(clock * ((n - 1) / clock[-1]), keys)(np.arange(n)) + _tremor(rng, n)
    positions = np.clip(states[:, :3], low, high)
    return _look(positions, *states[:, 3:].T)


def _viewpoint(
    rng: np.random.Generator, low: FloatArray, high: FloatArray, before: FloatArray | None
) -> FloatArray:
    """(x, y, z, yaw, pitch, roll) that looks at something beyond the free space, mostly not far aside."""
    for _ in range(20):
        position = rng.uniform(low, high)
        if before is not None:
            position = np.clip(position, before[:3] - STROLL_M, before[:3] + STROLL_M)
        bearing = rng.uniform(-math.pi, math.pi)
        target = (np.abs(high[:2]) + 0.7) * [math.cos(bearing), math.sin(bearing)]
        ahead = target - position[:2]
        yaw = math.atan2(ahead[1], ahead[0])
        if before is not None:  # turn the short way round
            yaw += 2 * math.pi * round((before[3] - yaw) / (2 * math.pi))
        gentle = before is None or abs(yaw - before[3]) < math.radians(80)
        if gentle and np.linalg.norm(ahead) > 1.5:
            break
    pitch = math.atan2(rng.uniform(0.4, 1.3) - position[2], np.linalg.norm(ahead))
    return np.array([*position, yaw, pitch, rng.normal(0, 0.05)])


def _duration(a: FloatArray, b: FloatArray) -> float:
    step_m, turn_rad = np.linalg.norm(a[:3] - b[:3]), np.abs(a[3:] - b[3:]).max()
    return float(max(12.0, step_m / FRAME_STEP_M, turn_rad / FRAME_STEP_RAD))


def _tremor(rng: np.random.Generator, n: int) -> FloatArray:
    """(n, 6) slow shaking of the hand: some millimetres and tenths of a degree."""
    waves = rng.uniform(0.05, 0.5, (4, 6)), rng.uniform(0, 2 * math.pi, (4, 6))
    phases = np.arange(n)[:, None, None] * waves[0] + waves[1]
    return np.asarray(np.sin(phases).sum(axis=1) * [0.003, 0.003, 0.003, 0.004, 0.004, 0.004])


def _look(positions: FloatArray, yaw: FloatArray, pitch: FloatArray, roll: FloatArray) -> FloatArray:
    """Poses (n, 4, 4) T_world_sensor of a camera; yaw about z from x, pitch up, roll about its axis."""
    zero = np.zeros_like(yaw)
    forward = np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)], axis=1)
    level_right = np.stack([np.sin(yaw), -np.cos(yaw), zero], axis=1)
    level_down = np.cross(forward, level_right)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    poses = np.tile(np.eye(4), (len(yaw), 1, 1))
    poses[:, :3, 0] = c * level_right + s * level_down
    poses[:, :3, 1] = c * level_down - s * level_right
    poses[:, :3, 2] = forward
    poses[:, :3, 3] = positions
    return poses


def _room(rng: np.random.Generator) -> tuple[float, float, Triangles]:
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
                parts.append(moved(_corner_piece(rng), x, y))
    if rng.random() < 0.8:
        parts += _dining_group(rng, a, b)
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
    kinds = (_shelf, _cabinet, _sofa, _desk, _shelf, _cabinet)
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


def _shelf(rng: np.random.Generator) -> tuple[float, Triangles]:
    w, d, h = rng.uniform(0.6, 1.2), rng.uniform(0.28, 0.4), rng.uniform(1.3, 2.1)
    boards = int(rng.integers(4, 7))
    parts = [box(-w / 2, w / 2, 0, 0.02, 0, h)]
    parts += [box(x - 0.015, x + 0.015, 0, d, 0, h) for x in (-w / 2, w / 2)]
    for z in np.linspace(0.08, h, boards):
        parts.append(box(-w / 2, w / 2, 0, d, z - 0.02, z))
    for z in np.linspace(0.08, h, boards)[:-1]:
        parts += _things(rng, w - 0.1, d, z, min(0.22, h / boards - 0.05), int(rng.integers(2, 6)))
    return w + 0.03, merge(parts)


def _cabinet(rng: np.random.Generator) -> tuple[float, Triangles]:
    w, d, h = rng.uniform(0.5, 1.2), rng.uniform(0.4, 0.6), rng.choice([0.8, 0.9, 1.9])
    doors = 2 if w > 0.8 else 1
    parts = [box(-w / 2, w / 2, 0, d, 0.06, h), box(-w / 2 + 0.03, w / 2 - 0.03, 0, d - 0.05, 0, 0.06)]
    for x in np.arange(doors) * w / doors - w / 2:
        parts.append(box(x + 0.01, x + w / doors - 0.01, d, d + 0.02, 0.1, h - 0.03))
        parts.append(box(x + 0.06, x + 0.08, d + 0.02, d + 0.05, h / 2, h / 2 + 0.15))
    if h < 1.5:
        parts += _things(rng, w - 0.1, d, h, 0.35, int(rng.integers(1, 5)))
    return w, merge(parts)


def _sofa(rng: np.random.Generator) -> tuple[float, Triangles]:
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


def _desk(rng: np.random.Generator) -> tuple[float, Triangles]:
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


def _dining_group(rng: np.random.Generator, a: float, b: float) -> list[Triangles]:
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


def _corner_piece(rng: np.random.Generator) -> Triangles:
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
