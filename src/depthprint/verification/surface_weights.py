"""How much each point of a view counts where agreement is judged: large flat surfaces are alike everywhere."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.projection import Projection
from depthprint.verification.surface import pixels_of, surface_at

__all__ = ["surface_weights", "weights_on_surface"]

FloatArray = npt.NDArray[np.float64]

# Points are of one surface whose normals share a bin of the compass, and whose planes one of distance.
_BEARINGS, _PLANE_M = 12, 1.0
# A surface with more than this share of the points counts by the square root of its size.
_SMALL_SHARE = 0.005


def surface_weights(
    points: npt.NDArray[np.float32], ranges_m: npt.NDArray[np.float32], projection: Projection
) -> npt.NDArray[np.float32]:
    """Weights (n,) float32 of points (n, 3) of a range image (h, w), sensor frame.

    A point counts by its range, since near facades and cars look alike everywhere, and less the larger the
    surface is that it lies on: a view of one long wall says little of where it is.
    """
    there, normals = surface_at(pixels_of(points, ranges_m, projection), ranges_m, projection)
    return weights_on_surface(points, there, normals, projection)


def weights_on_surface(
    points: npt.NDArray[np.float32], there: FloatArray, normals: FloatArray, projection: Projection
) -> npt.NDArray[np.float32]:
    """`surface_weights` of points (n, 3) where the surface's points and normals (n, 3) at their pixels are known."""
    flat = normals @ projection.R_flu_sensor.T
    bearing = np.floor(np.arctan2(flat[:, 1], flat[:, 0]) / (2 * np.pi) * _BEARINGS).astype(np.int64)
    plane = np.floor(np.einsum("nk,nk->n", there, normals) / _PLANE_M).astype(np.int64)
    upright = normals.any(axis=1) & (np.abs(flat[:, 2]) < 0.7)
    surface = np.where(upright, 1 + (bearing % _BEARINGS) + _BEARINGS * (plane - plane.min(initial=0)), 0)
    _, which, sizes = np.unique(surface, return_inverse=True, return_counts=True)
    size = np.where(upright, sizes[which], 1)
    share = np.minimum(1.0, np.sqrt(_SMALL_SHARE * max(1, len(points)) / size))
    return np.asarray(np.linalg.norm(points, axis=1) * share, dtype=np.float32)
