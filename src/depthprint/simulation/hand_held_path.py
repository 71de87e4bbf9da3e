"""Paths of a camera carried by hand about a room: there, and back not quite along the same way."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

__all__ = ["there_and_back"]

FloatArray = npt.NDArray[np.float64]

CAMERA_HEIGHTS_M = (1.05, 1.65)
FRAME_STEP_M, FRAME_STEP_RAD, STROLL_M = 0.03, math.radians(2.0), 0.8


def there_and_back(rng: np.random.Generator, n: int, free_m: FloatArray) -> FloatArray:
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
