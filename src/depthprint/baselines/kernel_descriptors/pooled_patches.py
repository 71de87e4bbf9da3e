"""Sums over the pixels of square patches of attribute kernel (x) position kernel, for all patches of a crop."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.match_kernel import MatchKernel, gaussian_kernel
from depthprint.baselines.kernel_descriptors.patch_grid import (
    PatchDescriptors,
    centre_positions,
    patch_corners,
)

__all__ = ["PATCH_PX", "SPATIAL_AXIS", "describe_patches", "describe_patterns"]

Float32Array = npt.NDArray[np.float32]

PATCH_PX = 16
SPATIAL_AXIS = np.linspace(0.0, 1.0, 5)
# Patches with a fainter contrast than this are not blown up to unit norm.
LEAST_NORM = 0.8


def describe_patches(
    numbers: npt.NDArray[np.int32], kernels: Float32Array, magnitude: Float32Array, kernel: MatchKernel
) -> PatchDescriptors:
    """Descriptors of the patches of a crop.

    numbers: (h, w) rows of ``kernels`` (n, p), each pixel's attribute against the basis, in its span; the first is
    that of pixels without any. magnitude: (h, w) weights of the pixels, scaled by patch to unit norm. The kernel's
    spatial basis is the square of SPATIAL_AXIS, rows first.
    """
    from depthprint._kernels.patch_sums import patch_sums

    axis = _axis_kernels(kernel.spatial_gamma)
    tops, lefts = patch_corners(magnitude.shape, PATCH_PX)
    sums, squares = patch_sums(numbers, kernels, magnitude, tops, lefts, axis)
    sums *= _scales(squares)[:, None, None]
    return PatchDescriptors(
        kernel.project_places(sums), centre_positions(tops, lefts, PATCH_PX, magnitude.shape)
    )


def describe_patterns(
    patterns: npt.NDArray[np.int32], projected: Float32Array, magnitude: Float32Array, kernel: MatchKernel
) -> PatchDescriptors:
    """Descriptors as ``describe_patches`` has them, of pixels whose attribute is one of few.

    patterns: (h, w), each below t. projected: (q t, k), what a unit of each pattern at each vector of the spatial
    span adds to the descriptor.
    """
    from depthprint._kernels.patch_sums import pattern_sums

    positions = _position_kernels(kernel)
    tops, lefts = patch_corners(magnitude.shape, PATCH_PX)
    sums, squares = pattern_sums(
        patterns, magnitude, tops, lefts, positions, len(projected) // len(positions)
    )
    sums *= _scales(squares)[:, None, None]
    vectors = sums.reshape(len(sums), -1).astype(np.float32) @ projected
    return PatchDescriptors(vectors, centre_positions(tops, lefts, PATCH_PX, magnitude.shape))


def _scales(squares: npt.NDArray[np.float64]) -> Float32Array:
    """What brings patches with these squared norms to unit norm, but for faint ones."""
    return np.asarray(1.0 / np.maximum(LEAST_NORM, np.sqrt(squares)), dtype=np.float32)


@lru_cache(maxsize=8)
def _axis_kernels(gamma: float) -> Float32Array:
    """(nodes, PATCH_PX) kernels of a patch's rows, or columns, against the spatial axis."""
    places = (np.arange(PATCH_PX) / PATCH_PX)[:, None]
    kernels = gaussian_kernel(places, SPATIAL_AXIS[:, None], gamma).T.astype(np.float32)
    kernels.setflags(write=False)
    return np.asarray(kernels)


def _position_kernels(kernel: MatchKernel) -> Float32Array:
    """(q, PATCH_PX, PATCH_PX) kernels of a patch's pixels against the spatial basis, in its span."""
    axis = _axis_kernels(kernel.spatial_gamma)
    kernels = np.einsum("ar,bc,abq->qrc", axis, axis, kernel.spatial_span.reshape(len(axis), len(axis), -1))
    return np.ascontiguousarray(kernels, dtype=np.float32)
