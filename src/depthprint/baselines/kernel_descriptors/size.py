"""Size kernel descriptor: distances from a point of the object to all others."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.match_kernel import MatchKernel, gaussian_kernel
from depthprint.baselines.kernel_descriptors.patch_grid import (
    PatchDescriptors,
    centre_positions,
    depth_and_points,
    patch_corners,
)
from depthprint.range_image import RangeImage

__all__ = ["size_descriptors", "size_kernel", "size_of_points"]

DIMS = 50
PATCH_PX = 40
DISTANCE_AXIS_M = np.linspace(0.0, 1.0, 100)
DISTANCE_GAMMA = 30.0
# Distances beyond the last node are too far from all of the basis to count.
NODE_STEP_M, N_NODES = 1 / 256, 516
MOST_POINTS = 1600
SAMPLING_SEED = 0


@lru_cache(maxsize=1)
def size_kernel() -> MatchKernel:
    """Match kernel of distances, 100 on [0, 1] m."""
    return MatchKernel.build(DISTANCE_AXIS_M[:, None].copy(), np.zeros((1, 1)), DISTANCE_GAMMA, 1.0, DIMS)


@lru_cache(maxsize=1)
def _node_descriptors() -> npt.NDArray[np.float64]:
    """Descriptors (N_NODES, 50) of single distances, those of the nodes: cubics between them are smooth enough."""
    nodes = NODE_STEP_M * (np.arange(N_NODES) - 1.0)
    kernels = gaussian_kernel(nodes[:, None], DISTANCE_AXIS_M[:, None], DISTANCE_GAMMA)
    return np.asarray(kernels @ size_kernel().directions[:, 0].astype(np.float64))


def size_descriptors(image: RangeImage, masked: bool = False) -> PatchDescriptors:
    """Descriptors (m, 50) about the points 8 pixels apart, 20 from the border at least; none without return.

    Raises DataError as depth_and_points does. Source: Bo, Ren and Fox 2011, section III.
    """
    return size_of_points(*depth_and_points(image, PATCH_PX, masked))


def size_of_points(depth: npt.NDArray[np.float32], points: npt.NDArray[np.float64]) -> PatchDescriptors:
    """``size_descriptors`` of the depth and points that ``depth_and_points`` gave."""
    from depthprint._kernels.point_kernels import mean_distance_shares

    rows, columns = patch_corners(depth.shape, PATCH_PX)
    half = PATCH_PX // 2
    centres = points[np.ix_(rows + half, columns + half)].reshape(-1, 3)
    positions = centre_positions(rows, columns, PATCH_PX, depth.shape)
    cloud = points[depth > 0]
    if len(cloud) > MOST_POINTS:
        cloud = cloud[_chosen_points(len(cloud))]
    known = centres[:, 2] > 0
    shares = mean_distance_shares(centres[known], np.ascontiguousarray(cloud), NODE_STEP_M, N_NODES)
    return PatchDescriptors((shares @ _node_descriptors()).astype(np.float32), positions[known])


@lru_cache(maxsize=64)
def _chosen_points(count: int) -> npt.NDArray[np.int64]:
    """The points that count of so many, always the same."""
    return np.random.default_rng(SAMPLING_SEED).permutation(count)[:MOST_POINTS]
