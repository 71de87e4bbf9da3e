"""Local binary pattern kernel descriptor: which neighbours lie at least as far as the centre."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.match_kernel import MatchKernel, gaussian_kernel, grid_basis
from depthprint.baselines.kernel_descriptors.patch_grid import PatchDescriptors, crop_depth
from depthprint.baselines.kernel_descriptors.pooled_patches import PATCH_PX, SPATIAL_AXIS, describe_patterns
from depthprint.range_image import RangeImage

__all__ = ["binary_patterns", "lbp_descriptors", "lbp_kernel"]

DIMS = 200
PATTERN_GAMMA = 3.0
SPATIAL_GAMMA = 3.0
NEIGHBOURS = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 2))


@lru_cache(maxsize=1)
def lbp_kernel() -> MatchKernel:
    """Match kernel of the 256 patterns and of positions, 5 x 5 on [0, 1]^2."""
    return MatchKernel.build(
        grid_basis(*[np.array([0.0, 1.0])] * 8),
        grid_basis(SPATIAL_AXIS, SPATIAL_AXIS),
        PATTERN_GAMMA,
        SPATIAL_GAMMA,
        DIMS,
    )


@lru_cache(maxsize=1)
def _pattern_table() -> npt.NDArray[np.float32]:
    """Kernel of each pattern, by its number, against the basis, in its span: (256, p)."""
    patterns = lbp_kernel().attribute
    kernels = gaussian_kernel(patterns, patterns, PATTERN_GAMMA)
    return (kernels @ lbp_kernel().attribute_span).astype(np.float32)


def binary_patterns(
    depth: npt.NDArray[np.float32],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float32]]:
    """Number of each pixel's pattern, the first neighbour its highest bit, and the deviation of the 9 depths."""
    height, width = depth.shape
    padded = np.pad(depth, 1)
    around = [padded[r : r + height, c : c + width] for r, c in NEIGHBOURS]
    numbers = np.zeros(depth.shape, dtype=np.int64)
    for neighbour in around:
        numbers = 2 * numbers + (neighbour >= depth)
    depths = [side.astype(np.float64) for side in (depth, *around)]
    mean = sum(depths) / len(depths)
    deviation = np.sqrt(sum((side - mean) ** 2 for side in depths) / (len(depths) - 1))
    return numbers, np.asarray(deviation, dtype=np.float32)


def lbp_descriptors(image: RangeImage, masked: bool = False) -> PatchDescriptors:
    """Descriptors (m, 200) of 16-pixel patches, 8 apart. Raises DataError as crop_depth does.

    Source: Bo, Ren and Fox 2010, section 3, on depth as in their 2011 paper.
    """
    depth = crop_depth(image, PATCH_PX, masked)
    numbers, deviation = binary_patterns(depth)
    return describe_patterns(numbers, _pattern_table(), deviation, lbp_kernel())
