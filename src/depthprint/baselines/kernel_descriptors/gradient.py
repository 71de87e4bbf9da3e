"""Gradient kernel descriptor: orientations of the depth gradient, weighed by its magnitude."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.match_kernel import MatchKernel, gaussian_products, grid_basis
from depthprint.baselines.kernel_descriptors.patch_grid import PatchDescriptors, crop_depth
from depthprint.baselines.kernel_descriptors.pooled_patches import PATCH_PX, SPATIAL_AXIS, describe_patches
from depthprint.range_image import RangeImage

__all__ = ["depth_gradient", "gradient_descriptors", "gradient_kernel"]

Float32Array = npt.NDArray[np.float32]

DIMS = 200
ORIENTATION_AXIS = np.linspace(-1.0, 1.0, 10)
ORIENTATION_GAMMA = 5.0
SPATIAL_GAMMA = 3.0
FILTER_PX, FILTER_SIGMA = 5, 0.8
LEAST_MAGNITUDE = 1e-5


@lru_cache(maxsize=1)
def gradient_kernel() -> MatchKernel:
    """Match kernel of orientations, 10 x 10 on [-1, 1]^2, and positions, 5 x 5 on [0, 1]^2."""
    return MatchKernel.build(
        grid_basis(ORIENTATION_AXIS, ORIENTATION_AXIS),
        grid_basis(SPATIAL_AXIS, SPATIAL_AXIS),
        ORIENTATION_GAMMA,
        SPATIAL_GAMMA,
        DIMS,
    )


def depth_gradient(depth: Float32Array) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Unit orientation (x, y) and magnitude of each pixel's gradient, (h, w) each; 0 outside the crop."""
    from scipy.ndimage import correlate

    offsets = np.arange(FILTER_PX) - FILTER_PX // 2
    bell = np.exp(-(offsets[:, None] ** 2 + offsets**2) / (2 * FILTER_SIGMA**2))
    gy, gx = (
        correlate(depth, (2.0 * side / np.abs(side).sum()).astype(np.float32), mode="constant")
        for side in np.gradient(bell / bell.sum())
    )
    magnitude = np.maximum(np.sqrt(gx**2 + gy**2), np.float32(LEAST_MAGNITUDE))
    return gx / magnitude, gy / magnitude, magnitude


def gradient_descriptors(image: RangeImage, masked: bool = False) -> PatchDescriptors:
    """Descriptors (m, 200) of 16-pixel patches, 8 apart. Raises DataError as crop_depth does.

    Source: Bo, Ren and Fox 2010, section 3, on depth as in their 2011 paper.
    """
    depth = crop_depth(image, PATCH_PX, masked)
    gx, gy, magnitude = depth_gradient(depth)
    kernel = gradient_kernel()
    orientations = np.stack([gx, gy], axis=-1)
    # Away from the object nothing slopes: there the kernel is that of no orientation.
    sloping = orientations.any(-1)
    kernels = np.empty((*depth.shape, kernel.attribute_span.shape[1]), dtype=np.float32)
    kernels[sloping] = _spanned(orientations[sloping])
    kernels[~sloping] = _spanned(np.zeros((1, 2), dtype=np.float32))
    return describe_patches(kernels, magnitude, kernel)


def _spanned(orientations: Float32Array) -> Float32Array:
    """Kernels of orientations (n, 2) against the basis, in its span: (n, p)."""
    kernel = gradient_kernel()
    return gaussian_products(orientations, kernel.attribute, ORIENTATION_GAMMA) @ kernel.attribute_span
