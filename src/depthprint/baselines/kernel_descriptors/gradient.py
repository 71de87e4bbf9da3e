"""Gradient kernel descriptor: orientations of the depth gradient, weighed by its magnitude."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.match_kernel import (
    MatchKernel,
    gaussian_kernel,
    gaussian_products,
    grid_basis,
)
from depthprint.baselines.kernel_descriptors.patch_grid import PatchDescriptors, crop_depth, mirrored_image
from depthprint.baselines.kernel_descriptors.pooled_patches import PATCH_PX, SPATIAL_AXIS, describe_patches
from depthprint.range_image import RangeImage

__all__ = ["depth_gradient", "gradient_descriptors", "gradient_kernel", "gradient_pair"]

Float32Array = npt.NDArray[np.float32]

DIMS = 200
ORIENTATION_AXIS = np.linspace(-1.0, 1.0, 10)
ORIENTATION_GAMMA = 5.0
SPATIAL_GAMMA = 3.0
FILTER_PX, FILTER_SIGMA = 5, 0.8
LEAST_MAGNITUDE = np.float32(1e-5)
# Cubics between so many orientations are as precise as single precision.
CIRCLE_NODES = 2048


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
    from depthprint._kernels.depth_slopes import depth_slopes

    gx, gy = depth_slopes(np.pad(depth, FILTER_PX // 2), *_filter())
    magnitude = np.maximum(np.sqrt(gx**2 + gy**2), LEAST_MAGNITUDE)
    return gx / magnitude, gy / magnitude, magnitude


@lru_cache(maxsize=1)
def _filter() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Bell and slope (5,) whose product is the filter, the slope of a bell: of absolute sum 2."""
    offsets = np.arange(FILTER_PX) - FILTER_PX // 2
    bell = np.exp(-(offsets**2) / (2 * FILTER_SIGMA**2))
    slope = np.gradient(bell)
    return bell, 2.0 * slope / (np.abs(slope).sum() * bell.sum())


def gradient_descriptors(image: RangeImage, masked: bool = False) -> PatchDescriptors:
    """Descriptors (m, 200) of 16-pixel patches, 8 apart. Raises DataError as crop_depth does.

    Source: Bo, Ren and Fox 2010, section 3, on depth as in their 2011 paper.
    """
    return _described(*depth_gradient(crop_depth(image, PATCH_PX, masked)))


def gradient_pair(image: RangeImage, masked: bool = False) -> tuple[PatchDescriptors, PatchDescriptors]:
    """Descriptors of an image and of its mirror image, whose gradients are the same turned round."""
    gx, gy, magnitude = depth_gradient(crop_depth(image, PATCH_PX, masked))
    straight = _described(gx, gy, magnitude)
    # An image narrower than a patch has margins, which need not be the same on both sides.
    if image.shape[1] < PATCH_PX:
        return straight, gradient_descriptors(mirrored_image(image), masked)
    return straight, _described(*(np.ascontiguousarray(side[:, ::-1]) for side in (-gx, gy, magnitude)))


def _described(gx: Float32Array, gy: Float32Array, magnitude: Float32Array) -> PatchDescriptors:
    from depthprint._kernels.tables import read_rows

    # Away from the object nothing slopes: there the kernel is that of no orientation.
    sloping = (gx != 0) | (gy != 0)
    numbers = np.zeros(gx.shape, dtype=np.int32)
    numbers[sloping] = np.arange(1, 1 + np.count_nonzero(sloping))
    x, y = gx[sloping], gy[sloping]
    table = _circle_kernels()
    kernels = np.empty((1 + len(x), table.shape[1]), dtype=np.float32)
    kernels[0] = _plain_kernel()
    turns = np.arctan2(y, x, dtype=np.float64) / (2 * np.pi) + 0.5
    read_rows(turns * CIRCLE_NODES + 1, table, kernels[1:])
    # Only where a gradient is cut off at the least magnitude is its orientation shorter than 1.
    faint = np.flatnonzero(magnitude[sloping] <= LEAST_MAGNITUDE)
    if len(faint):
        kernels[1 + faint] = _spanned(np.stack([x[faint], y[faint]], axis=1))
    return describe_patches(numbers, kernels, magnitude, gradient_kernel())


@lru_cache(maxsize=1)
def _circle_kernels() -> Float32Array:
    """``_spanned`` of unit orientations at nodes a circle round from (-1, 0), with one more before and two after."""
    angles = (np.arange(CIRCLE_NODES + 3) - 1) * (2 * np.pi / CIRCLE_NODES) - np.pi
    kernel = gradient_kernel()
    orientations = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    kernels = gaussian_kernel(orientations, kernel.attribute, ORIENTATION_GAMMA) @ kernel.attribute_span
    return kernel.padded(kernels.astype(np.float32))


@lru_cache(maxsize=1)
def _plain_kernel() -> Float32Array:
    return np.asarray(_spanned(np.zeros((1, 2), dtype=np.float32))[0])


def _spanned(orientations: Float32Array) -> Float32Array:
    """Kernels of orientations (n, 2) against the basis, in its padded span: (n, p)."""
    kernel = gradient_kernel()
    products = gaussian_products(orientations, kernel.attribute, ORIENTATION_GAMMA)
    return kernel.padded(products @ kernel.attribute_span)
