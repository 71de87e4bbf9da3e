"""How much each point of a view counts where agreement is judged: large flat surfaces are alike everywhere."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.projection import Projection

__all__ = ["row_weights", "surface_weights"]

FloatArray = npt.NDArray[np.float64]

# Points are of one surface whose normals share a bin of the compass, and whose planes one of distance.
_BEARINGS, _PLANE_M = 12, 1.0
# Of one row, whose walls are told apart by less; two returns further apart are not of one line.
_ROW_BEARINGS, _ROW_PLANE_M, _ROW_GAP_M = 24, 0.5, 0.5
# A surface with more than this share of the points counts by the square root of its size.
_SMALL_SHARE = 0.005


def surface_weights(
    points: npt.NDArray[np.float32], there: FloatArray, normals: FloatArray, projection: Projection
) -> npt.NDArray[np.float32]:
    """Weights (n,) float32 of points (n, 3) of a view, sensor frame, on the surface that its pixels show.

    there, normals: (n, 3) the surface's points and normals at their pixels, 0 where unknown.
    A point counts by its range, since near facades and cars look alike everywhere, and less the larger the
    surface is that it lies on: a view of one long wall says little of where it is.
    """
    flat = normals @ projection.R_flu_sensor.T
    upright = np.asarray(normals.any(axis=1) & (np.abs(flat[:, 2]) < 0.7))
    distances_m = np.einsum("nk,nk->n", there, normals)
    return _by_range(points, _sizes(flat[:, :2], distances_m, upright, _BEARINGS, _PLANE_M))


def row_weights(points: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """As `surface_weights`, of points (n, 3) of a planar scan in beam order, whose surfaces are lines."""
    from depthprint._kernels.scan_icp import line_normals

    scan = np.ascontiguousarray(points[:, :2], dtype=np.float64)
    normals = np.empty_like(scan)
    line_normals(scan, _ROW_GAP_M, normals)
    distances_m = np.einsum("nk,nk->n", scan, normals)
    return _by_range(points, _sizes(normals, distances_m, normals.any(axis=1), _ROW_BEARINGS, _ROW_PLANE_M))


def _by_range(points: npt.NDArray[np.float32], size: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
    """Weights (n,) of points by their range and the sizes (n,) of the surfaces that they lie on."""
    share = np.minimum(1.0, np.sqrt(_SMALL_SHARE * max(1, len(points)) / size))
    return np.asarray(np.linalg.norm(points, axis=1) * share, dtype=np.float32)


def _sizes(
    normals: FloatArray,
    distances_m: FloatArray,
    known: npt.ArrayLike,
    bearings: int,
    plane_m: float,
) -> npt.NDArray[np.int64]:
    """Points (n,) that share each one's surface, by the bearing of its normal (n, 2) and the distance of its plane.

    1 where the surface is not ``known``.
    """
    bearing = np.floor(np.arctan2(normals[:, 1], normals[:, 0]) / (2 * np.pi) * bearings).astype(np.int64)
    plane = np.floor(distances_m / plane_m).astype(np.int64)
    surface = np.where(known, 1 + (bearing % bearings) + bearings * (plane - plane.min(initial=0)), 0)
    _, which, sizes = np.unique(surface, return_inverse=True, return_counts=True)
    return np.asarray(np.where(known, sizes[which], 1), dtype=np.int64)
