"""The surface that a range image shows: points and normals at pixels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.projection import Projection, Spherical

__all__ = ["pixels_of", "surface_at"]

FloatArray = npt.NDArray[np.float64]

# Half of the window that a normal is fitted over, pixels, and the step of range, as a share of it, that ends a surface.
_REACH, _EDGE_RATIO = 3, 0.1


def pixels_of(
    points: npt.NDArray[np.float32], ranges_m: npt.NDArray[np.float32], projection: Projection
) -> npt.NDArray[np.int64]:
    """Numbers (n,), row by row, of the pixels nearest to points (n, 3) that a range image (h, w) holds."""
    height, width = ranges_m.shape
    u, v, _ = projection.project(points)
    columns = np.round(u).astype(np.int64) % width
    rows = np.clip(np.round(v).astype(np.int64), 0, height - 1)
    return np.asarray(rows * width + columns)


def surface_at(
    pixels: npt.NDArray[np.int64], ranges_m: npt.NDArray[np.float32], projection: Projection
) -> tuple[FloatArray, FloatArray]:
    """Points and unit normals (n, 3), sensor frame, at pixels (n,) of a range image (h, w); normal 0 where unknown."""
    from depthprint._kernels.projective_icp import window_normals

    rows, columns = np.divmod(pixels, ranges_m.shape[1])
    points, normals = np.empty((len(rows), 3)), np.empty((len(rows), 3))
    wraps = isinstance(projection, Spherical) and projection.wraps
    window_normals(
        ranges_m, projection.directions(), rows, columns, _REACH, _EDGE_RATIO, wraps, points, normals
    )
    return points, normals
