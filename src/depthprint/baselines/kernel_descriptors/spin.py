"""Spin kernel descriptor: normals and places of the points around a point, in its own frame."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.match_kernel import MatchKernel, gaussian_kernel, grid_basis
from depthprint.baselines.kernel_descriptors.patch_grid import (
    PatchDescriptors,
    centre_positions,
    depth_and_points,
    patch_corners,
)
from depthprint.range_image import RangeImage

__all__ = ["spin_descriptors", "spin_kernel", "spin_of_points", "surface_normals"]

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

DIMS = 200
PATCH_PX = 40
RADIUS_M = 0.05
ANGLES_RAD = np.linspace(0.0, 2 * np.pi, 50)
ALONG_AXIS_M = np.linspace(-RADIUS_M, RADIUS_M, 10)
ACROSS_AXIS_M = np.linspace(0.0, RADIUS_M, 5)
ANGLE_GAMMA = 3.0
SPATIAL_GAMMA = 300.0
NORMAL_WINDOW_PX = 11
NORMAL_DEPTH_RATIO = 0.01
NORMAL_LEAST_POINTS = 4
LEAST_POINTS, MOST_POINTS = 11, 256
SAMPLING_SEED = 0
# Cubics between so many nodes of a range are as precise as single precision.
NODES = 512


@lru_cache(maxsize=1)
def spin_kernel() -> MatchKernel:
    """Match kernel of 50 angles as (sin, cos), and of places: 10 along the normal x 5 across, metres."""
    return MatchKernel.build(
        np.stack([np.sin(ANGLES_RAD), np.cos(ANGLES_RAD)], axis=1),
        grid_basis(ALONG_AXIS_M, ACROSS_AXIS_M),
        ANGLE_GAMMA,
        SPATIAL_GAMMA,
        DIMS,
    )


def surface_normals(points: FloatArray) -> FloatArray:
    """Unit normals (h, w, 3) of points (h, w, 3) with z = 0 for no return; zero where too few points lie near.

    Principal component of least variance in windows of 11 x 11 pixels, over points within 1 % of the depth,
    oriented away from the camera.
    """
    from depthprint._kernels.principal_normals import principal_normals

    normals = principal_normals(
        np.ascontiguousarray(points), NORMAL_WINDOW_PX // 2, NORMAL_DEPTH_RATIO, NORMAL_LEAST_POINTS
    )
    return np.asarray(normals)


def spin_descriptors(image: RangeImage, masked: bool = False) -> PatchDescriptors:
    """Descriptors (m, 200) about the points 8 pixels apart, 20 from the border at least.

    A place without return, or with ten points or fewer within 5 cm, has none; of more than 256 points a fixed
    random choice counts. Raises DataError as depth_and_points does. Source: Bo, Ren and Fox 2011, section III.
    """
    return spin_of_points(*depth_and_points(image, PATCH_PX, masked))


def spin_of_points(depth: Float32Array, points: FloatArray) -> PatchDescriptors:
    """``spin_descriptors`` of the depth and points that ``depth_and_points`` gave."""
    from depthprint._kernels.point_kernels import spin_coordinates

    normals = surface_normals(points)
    rows, columns = patch_corners(depth.shape, PATCH_PX)
    positions = centre_positions(rows, columns, PATCH_PX, depth.shape)
    coordinates, counts = spin_coordinates(
        np.ascontiguousarray(points), normals, rows, columns, PATCH_PX, _order(), RADIUS_M, MOST_POINTS
    )
    return PatchDescriptors(_means(coordinates, counts), positions[counts >= LEAST_POINTS])


@lru_cache(maxsize=1)
def _order() -> npt.NDArray[np.int64]:
    return np.random.default_rng(SAMPLING_SEED).permutation(PATCH_PX * PATCH_PX)


def _means(coordinates: Float32Array, counts: npt.NDArray[np.int64]) -> Float32Array:
    """Descriptors (m, 200): means of the kernels of (cos, along, across), (n, 3), over the points of each patch.

    Patches with too few points are left out.
    """
    from depthprint._kernels.tables import read_products, read_rows

    kernel = spin_kernel()
    attribute_table, along_table, across_table = _tables()
    cosine, along, across = coordinates.T.astype(np.float64)
    attribute = np.empty((len(coordinates), attribute_table.shape[1]), dtype=np.float32)
    read_rows(np.arccos(cosine) * (NODES / np.pi) + 1, attribute_table, attribute)
    spatial = read_products(
        (along / RADIUS_M + 1) * (NODES / 2) + 1, along_table, across * (NODES / RADIUS_M) + 1, across_table
    )
    known = np.flatnonzero(counts >= LEAST_POINTS)
    sums = np.empty((len(known), spatial.shape[1], attribute.shape[1]), dtype=np.float32)
    ends = np.cumsum(counts)
    for number, patch in enumerate(known):
        points = slice(ends[patch] - counts[patch], ends[patch])
        np.matmul(spatial[points].T, attribute[points], out=sums[number])
    sums /= counts[known].astype(np.float32)[:, None, None]
    return kernel.project_places(sums)


@lru_cache(maxsize=1)
def _tables() -> tuple[Float32Array, ...]:
    """Kernels of angles in their span, of places along, and of places across, at the nodes of their ranges.

    The latter two have a column for each point of the spatial basis, so that their product is that of both.
    """
    kernel = spin_kernel()
    share = (np.arange(NODES + 3) - 1) / NODES
    angles = np.stack([np.sin(np.pi * share), np.cos(np.pi * share)], axis=1)
    attribute = gaussian_kernel(angles, kernel.attribute, ANGLE_GAMMA) @ kernel.attribute_span
    along, across = (
        gaussian_kernel(places[:, None], axis[:, None], SPATIAL_GAMMA)
        for places, axis in (((2 * share - 1) * RADIUS_M, ALONG_AXIS_M), (share * RADIUS_M, ACROSS_AXIS_M))
    )
    along = np.repeat(along, len(ACROSS_AXIS_M), axis=1)
    across = np.tile(across, (1, len(ALONG_AXIS_M)))
    return kernel.padded(attribute.astype(np.float32)), along.astype(np.float32), across.astype(np.float32)
