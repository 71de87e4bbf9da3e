"""A place: a frame that was kept, to be recognised later."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError

__all__ = ["Place", "checked_pose"]


@dataclass(frozen=True)
class Place:
    """A stored place: its number, stamp, pose T_world_sensor (4, 4) float64, and where it came from."""

    number: int
    stamp_s: float | None = None
    T_world_sensor: npt.NDArray[np.float64] | None = None
    source: str = ""


def checked_pose(pose: npt.ArrayLike, number: int) -> npt.NDArray[np.float64]:
    """A read-only copy of the pose of frame ``number``; DataError unless it is (4, 4) and finite."""
    T_world_sensor = np.array(pose, dtype=np.float64)
    if T_world_sensor.shape != (4, 4) or not np.isfinite(T_world_sensor).all():
        raise DataError(f"frame {number}: expected a finite pose (4, 4), got shape {T_world_sensor.shape}")
    T_world_sensor.setflags(write=False)
    return T_world_sensor
