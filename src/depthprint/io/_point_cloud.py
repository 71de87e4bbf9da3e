"""The type that point-cloud readers return."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError

__all__ = ["PointCloud"]


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of one file.

    points: (n, 3) float32 x, y, z in metres, row by row when organised; NaN = no return; read-only.
    width, height: n = width * height; height 1 when the cloud is not organised.
    viewpoint: (7,) float64 tx, ty, tz, qw, qx, qy, qz of the sensor in the frame of the points.
    intensity: (n,) float32, or None.
    source: the file.
    """

    points: npt.NDArray[np.float32]
    width: int
    height: int = 1
    viewpoint: npt.NDArray[np.float64] | None = None
    intensity: npt.NDArray[np.float32] | None = None
    source: str = ""

    def __post_init__(self) -> None:
        name = self.source or "PointCloud"
        points = np.array(self.points, dtype=np.float32)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) != self.width * self.height:
            raise DataError(
                f"{name}: expected points of shape ({self.width} * {self.height}, 3), got {points.shape}"
            )
        fields: dict[str, npt.NDArray[np.generic]] = {"points": points}
        if self.intensity is not None:
            fields["intensity"] = np.array(self.intensity, dtype=np.float32)
            if fields["intensity"].shape != (len(points),):
                raise DataError(
                    f"{name}: expected {len(points)} intensities, got {fields['intensity'].shape}"
                )
        if self.viewpoint is not None:
            fields["viewpoint"] = np.array(self.viewpoint, dtype=np.float64)
            if fields["viewpoint"].shape != (7,):
                raise DataError(f"{name}: expected a viewpoint of 7 numbers, got {fields['viewpoint'].shape}")
        for key, array in fields.items():
            array.setflags(write=False)
            object.__setattr__(self, key, array)

    def __len__(self) -> int:
        return len(self.points)

    @property
    def organised(self) -> bool:
        """Whether the points are rows and columns of an image."""
        return self.height > 1

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """(n,) bool: points without NaN."""
        return np.asarray(np.isfinite(self.points).all(axis=1))
