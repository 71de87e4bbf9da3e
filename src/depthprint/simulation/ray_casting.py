"""Ray casting of triangle soups with Embree, for any projection."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.projection import Pinhole, Projection
from depthprint.simulation.meshes import Triangles

__all__ = ["RayScene", "nearest_surface"]

# The most float32 leaves to say that a ray met nothing.
_MISS_M = 1e6


class RayScene:
    """Triangles (n, 3, 3) float32, metres, in the world frame, prepared for casting; may be empty."""

    def __init__(self, triangles: Triangles) -> None:
        self._scene = None
        if len(triangles):
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene

            self._scene = EmbreeScene()
            TriangleMesh(self._scene, np.ascontiguousarray(triangles, dtype=np.float32))

    def cast(
        self, projection: Projection, T_world_sensor: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float32]:
        """Noise-free ranges (height, width) float32: z for a Pinhole, else Euclidean; NaN where nothing is hit.

        T_world_sensor: (4, 4) pose of the projection's own sensor frame.
        """
        shape = (projection.height, projection.width)
        if self._scene is None:
            return np.full(shape, np.nan, dtype=np.float32)
        local, lengths = _unit_rays(projection)
        rays = local @ T_world_sensor[:3, :3].T
        origins = np.broadcast_to(T_world_sensor[:3, 3], rays.shape)
        hits = self._scene.run(
            np.ascontiguousarray(origins, dtype=np.float32), rays.astype(np.float32), query="DISTANCE"
        )
        ranges = np.where((hits > 0) & (hits < _MISS_M), hits, np.nan)
        if isinstance(projection, Pinhole):
            ranges = ranges / lengths
        return ranges.astype(np.float32).reshape(shape)


@lru_cache(maxsize=8)
def _unit_rays(projection: Projection) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    directions = projection.directions().reshape(-1, 3)
    lengths = np.linalg.norm(directions, axis=1)
    return directions / lengths[:, None], lengths


def nearest_surface(*ranges_m: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Per pixel the nearest of several casts; NaN only where none hit."""
    nearest = ranges_m[0]
    for other in ranges_m[1:]:
        nearest = np.fmin(nearest, other)
    return nearest
