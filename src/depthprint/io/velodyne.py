"""Velodyne scans as KITTI stores them: float32 x, y, z, intensity, one point after another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.io._files import read_bytes
from depthprint.io.atomic import atomic_path

__all__ = ["read_velodyne_bin", "write_velodyne_bin"]

_POINT_BYTES = 16


def read_velodyne_bin(path: Path | str) -> npt.NDArray[np.float32]:
    """(n, 4) float32: x forward, y left, z up in metres, and intensity.

    Raises DataError naming the file when it is missing, empty, or not a whole number of points.
    """
    path = Path(path)
    content = read_bytes(path)
    if len(content) % _POINT_BYTES:
        raise DataError(
            f"{path}: expected a whole number of points of {_POINT_BYTES} bytes, got {len(content)} bytes"
        )
    return np.frombuffer(content, dtype="<f4").astype(np.float32).reshape(-1, 4)


def write_velodyne_bin(path: Path | str, points: npt.ArrayLike) -> None:
    """Write (n, 4) points as float32 x, y, z, intensity."""
    array = np.asarray(points)
    if array.ndim != 2 or array.shape[1] != 4 or len(array) == 0:
        raise DataError(f"{path}: expected points of shape (n, 4), got {array.shape}")
    with atomic_path(path) as temporary:
        temporary.write_bytes(array.astype("<f4").tobytes())
