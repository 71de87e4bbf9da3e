"""Local binary pattern kernel descriptor: which neighbours lie at least as far as the centre."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.match_kernel import MatchKernel, gaussian_kernel, grid_basis
from depthprint.baselines.kernel_descriptors.patch_grid import PatchDescriptors, crop_depth, mirrored_image
from depthprint.baselines.kernel_descriptors.pooled_patches import PATCH_PX, SPATIAL_AXIS, describe_patterns
from depthprint.range_image import RangeImage

__all__ = ["binary_patterns", "lbp_descriptors", "lbp_kernel", "lbp_pair"]

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
def _projected_patterns() -> npt.NDArray[np.float32]:
    """What a unit of each pattern, by its number, adds to the descriptor: (q 256, 200)."""
    kernel = lbp_kernel()
    table = gaussian_kernel(kernel.attribute, kernel.attribute, PATTERN_GAMMA) @ kernel.attribute_span
    projected = np.einsum("tp,pqk->qtk", table, kernel.core.astype(np.float64), optimize=True)
    return np.ascontiguousarray(projected, dtype=np.float32).reshape(-1, DIMS)


@lru_cache(maxsize=1)
def _mirrored_patterns() -> npt.NDArray[np.int32]:
    """Number of the mirrored pattern of each, (256,)."""
    bits = (np.arange(256)[:, None] >> np.arange(7, -1, -1)) & 1
    seen = [NEIGHBOURS.index((row, 2 - column)) for row, column in NEIGHBOURS]
    return np.asarray(bits[:, seen] @ (1 << np.arange(7, -1, -1)), dtype=np.int32)


def binary_patterns(
    depth: npt.NDArray[np.float32],
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
    """Number of each pixel's pattern, the first neighbour its highest bit, and the deviation of the 9 depths."""
    from depthprint._kernels.pixel_patterns import pixel_patterns

    numbers, deviation = pixel_patterns(np.pad(depth, 1))
    return numbers, deviation


def lbp_descriptors(image: RangeImage, masked: bool = False) -> PatchDescriptors:
    """Descriptors (m, 200) of 16-pixel patches, 8 apart. Raises DataError as crop_depth does.

    Source: Bo, Ren and Fox 2010, section 3, on depth as in their 2011 paper.
    """
    return _described(*binary_patterns(crop_depth(image, PATCH_PX, masked)))


def lbp_pair(image: RangeImage, masked: bool = False) -> tuple[PatchDescriptors, PatchDescriptors]:
    """Descriptors of an image and of its mirror image, whose patterns are the same with neighbours exchanged."""
    numbers, deviation = binary_patterns(crop_depth(image, PATCH_PX, masked))
    straight = _described(numbers, deviation)
    # An image narrower than a patch has margins, which need not be the same on both sides.
    if image.shape[1] < PATCH_PX:
        return straight, lbp_descriptors(mirrored_image(image), masked)
    turned = _mirrored_patterns()[numbers[:, ::-1]]
    return straight, _described(turned, np.ascontiguousarray(deviation[:, ::-1]))


def _described(numbers: npt.NDArray[np.int32], deviation: npt.NDArray[np.float32]) -> PatchDescriptors:
    return describe_patterns(numbers, _projected_patterns(), deviation, lbp_kernel())
