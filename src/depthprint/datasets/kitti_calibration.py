"""calib.txt of the KITTI odometry set: projections of the four rectified cameras, and the LiDAR's place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError

__all__ = ["KittiCalibration", "StereoRig", "read_kitti_calibration"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class StereoRig:
    """A rectified pair: intrinsics in pixels, baseline in metres, and T_cam0_left (4, 4)."""

    fx: float
    fy: float
    cx: float
    cy: float
    baseline_m: float
    T_cam0_left: FloatArray


@dataclass(frozen=True)
class KittiCalibration:
    """matrices: P0..P3 and, where given, Tr, each (3, 4) float64; path: the file, for messages."""

    matrices: dict[str, FloatArray]
    path: Path

    @property
    def T_cam0_velo(self) -> FloatArray | None:
        """Place of the LiDAR in the frame of camera 0, the entry Tr; None where it is absent."""
        return _homogeneous(self.matrices["Tr"]) if "Tr" in self.matrices else None

    def rig(self, left: int, right: int) -> StereoRig:
        """Pair of cameras P_left = K [I | t] and P_right; DataError where they are absent or no pair."""
        for camera in (left, right):
            if f"P{camera}" not in self.matrices:
                raise DataError(f"{self.path}: expected a row P{camera}, got {', '.join(self.matrices)}")
        P_left, P_right = self.matrices[f"P{left}"], self.matrices[f"P{right}"]
        K = P_left[:, :3]
        if not np.allclose(K, P_right[:, :3], rtol=1e-6) or not (K[0, 0] > 0 and K[1, 1] > 0):
            raise DataError(
                f"{self.path}: expected one camera matrix with fx, fy > 0 in P{left} and P{right}"
            )
        baseline_m = float((P_left[0, 3] - P_right[0, 3]) / K[0, 0])
        if not baseline_m > 0:
            raise DataError(
                f"{self.path}: expected camera {right} right of {left}, got baseline {baseline_m:g} m"
            )
        T_cam0_left = np.eye(4)
        T_cam0_left[:3, 3] = -np.linalg.solve(K, P_left[:, 3])
        return StereoRig(
            float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), baseline_m, T_cam0_left
        )


def read_kitti_calibration(path: Path | str) -> KittiCalibration:
    """Read rows 'name: 12 numbers'; raises DataError naming file and row for anything else."""
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read as a calibration: {error}") from error
    matrices: dict[str, FloatArray] = {}
    for row, line in enumerate(lines, start=1):
        name, colon, rest = line.partition(":")
        if not line.strip():
            continue
        try:
            values = np.array([float(v) for v in rest.split()])
        except ValueError as error:
            raise DataError(f"{path}: line {row}: expected numbers, got {error}") from error
        if not colon or len(values) != 12 or not np.isfinite(values).all():
            raise DataError(
                f"{path}: line {row}: expected 'name: 12 finite numbers', got {line.strip()[:60]!r}"
            )
        matrices[name.strip()] = values.reshape(3, 4)
    return KittiCalibration(matrices, path)


def _homogeneous(matrix: FloatArray) -> FloatArray:
    return np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]])
