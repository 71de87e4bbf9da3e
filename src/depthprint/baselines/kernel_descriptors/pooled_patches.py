"""Sums over the pixels of square patches of attribute kernel (x) position kernel, for all patches of a crop."""

from __future__ import annotations

from typing import TypeVar

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
Value = TypeVar("Value", bound=np.generic)

PATCH_PX = 16
SPATIAL_AXIS = np.linspace(0.0, 1.0, 5)
# Patches with a fainter contrast than this are not blown up to unit norm.
LEAST_NORM = 0.8


def describe_patches(
    attribute_kernels: Float32Array, magnitude: Float32Array, kernel: MatchKernel
) -> PatchDescriptors:
    """Descriptors of the patches of a crop.

    attribute_kernels: (h, w, p), each pixel's attribute against the basis, in its span. magnitude: (h, w) weights of
    the pixels, scaled by patch to unit norm. The kernel's spatial basis is the square of SPATIAL_AXIS, rows first.
    """
    weighed = _patch_weights(magnitude)[:, :, None] * _position_kernels(kernel)
    sums = np.swapaxes(_patches(attribute_kernels), 1, 2) @ weighed
    return PatchDescriptors(kernel.project(sums), _positions(magnitude.shape))


def describe_patterns(
    patterns: npt.NDArray[np.int64], table: Float32Array, magnitude: Float32Array, kernel: MatchKernel
) -> PatchDescriptors:
    """Descriptors as ``describe_patches`` has them, of pixels whose attribute is one of few.

    patterns: (h, w) rows of ``table`` (t, p), the attributes against the basis, in its span.
    """
    weights = _patch_weights(magnitude)
    numbers = _patches(patterns) + len(table) * np.arange(len(weights))[:, None]
    counts = np.stack(
        [
            np.bincount(numbers.ravel(), (weights * here).ravel(), len(table) * len(weights))
            for here in _position_kernels(kernel).T
        ],
        axis=-1,
    ).reshape(len(weights), len(table), -1)
    sums = table.T @ counts.astype(np.float32)
    return PatchDescriptors(kernel.project(sums), _positions(magnitude.shape))


def _patches(pixels: npt.NDArray[Value]) -> npt.NDArray[Value]:
    """(patches, PATCH_PX^2, ...) of pixels (h, w, ...), patches and their pixels row by row."""
    rows, columns = (
        first[:, None] + np.arange(PATCH_PX) for first in patch_corners(pixels.shape[:2], PATCH_PX)
    )
    chosen = pixels[rows[:, None, :, None], columns[None, :, None, :]]
    return chosen.reshape(-1, PATCH_PX**2, *pixels.shape[2:])


def _patch_weights(magnitude: Float32Array) -> Float32Array:
    weights = _patches(magnitude)
    norms = np.linalg.norm(weights.astype(np.float64), axis=1)
    return np.asarray(weights / np.maximum(LEAST_NORM, norms)[:, None].astype(np.float32))


def _position_kernels(kernel: MatchKernel) -> Float32Array:
    """(PATCH_PX^2, q) kernels of a patch's pixels against the spatial basis, in its span."""
    places = (np.arange(PATCH_PX) / PATCH_PX)[:, None]
    axis = gaussian_kernel(places, SPATIAL_AXIS[:, None], kernel.spatial_gamma)
    return (np.kron(axis, axis) @ kernel.spatial_span).astype(np.float32)


def _positions(shape: tuple[int, ...]) -> Float32Array:
    rows, columns = patch_corners(shape, PATCH_PX)
    return centre_positions(rows, columns, PATCH_PX, shape)
