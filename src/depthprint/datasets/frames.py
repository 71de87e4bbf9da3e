"""What the loaders share: frame order, thinning, and the checks on counts and sizes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import RangeSequence
from depthprint.errors import DataError, SettingsError

__all__ = ["natural_order", "require_frames", "thin", "up_axis"]

T = TypeVar("T")


def natural_order(paths: Iterable[Path]) -> list[Path]:
    """Sort by name with runs of digits compared as numbers: frame2 before frame10."""

    def key(path: Path) -> list[tuple[int, int, str]]:
        parts = re.split(r"(\d+)", path.name)
        return [(0, int(p), p) if p.isdigit() else (1, 0, p) for p in parts]

    return sorted(paths, key=key)


def thin(items: Sequence[T], every: int) -> list[T]:
    """Every n-th item, the first included. Raises SettingsError for every < 1."""
    if not isinstance(every, int) or isinstance(every, bool) or every < 1:
        raise SettingsError(f"every: expected a whole number >= 1, got {every!r}")
    return list(items[::every])


def require_frames(sequence: RangeSequence, minimum: int = 2) -> RangeSequence:
    """Return the sequence, or raise DataError when it has fewer frames than its use needs."""
    if len(sequence) < minimum:
        noun = "frame" if len(sequence) == 1 else "frames"
        raise DataError(f"{sequence.name}: expected at least {minimum} frames, got {len(sequence)} {noun}")
    return sequence


def up_axis(
    poses: npt.NDArray[np.float64], sensor_up: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Axis of the world nearest to the sensor's mean 'up' over poses (n, 4, 4) T_world_sensor.

    sensor_up: 'up' in the sensor frame, (0, -1, 0) for a camera, (0, 0, 1) for a scanner. A guess for data
    whose world frame is not documented; it holds while the sensor leans less than about 45 degrees on
    average.
    """
    mean_up = (poses[:, :3, :3] @ np.asarray(sensor_up)).mean(axis=0)
    axis = int(np.argmax(np.abs(mean_up)))
    up = [0.0, 0.0, 0.0]
    up[axis] = 1.0 if mean_up[axis] > 0 else -1.0
    return (up[0], up[1], up[2])
