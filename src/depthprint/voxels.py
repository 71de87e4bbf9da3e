"""Point clouds thinned to one point a voxel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.errors import SettingsError
from depthprint.range_image import RangeImage

__all__ = ["voxel_points"]


def voxel_points(image: RangeImage, voxel_m: float) -> npt.NDArray[np.float32]:
    """(n, 3) float32, metres, in the sensor frame: the mean of the returns in each voxel, in the voxels' order.

    Raises SettingsError for a side that is not positive.
    """
    if not (np.isfinite(voxel_m) and voxel_m > 0):
        raise SettingsError(f"voxel_m: expected a length > 0, got {voxel_m}")
    points = image.points().reshape(-1, 3)
    points = points[np.isfinite(points[:, 0])].astype(np.float64)
    if not len(points):
        return np.empty((0, 3), dtype=np.float32)
    cells = np.floor(points / voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    keys = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    _, which, counts = np.unique(keys, return_inverse=True, return_counts=True)
    sums = [np.bincount(which, weights=points[:, axis]) for axis in range(3)]
    return np.asarray((np.stack(sums) / counts).T, dtype=np.float32, order="C")
