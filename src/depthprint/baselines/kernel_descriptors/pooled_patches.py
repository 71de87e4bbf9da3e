"""Sums over the pixels of square patches of attribute kernel (x) position kernel, for all patches of a crop."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.match_kernel import MatchKernel, gaussian_kernel
from depthprint.baselines.kernel_descriptors.patch_grid import (
    PatchDescriptors,
    centre_positions,
    patch_corners,
)

__all__ = ["PATCH_PX", "SPATIAL_AXIS", "describe_patches"]

PATCH_PX = 16
SPATIAL_AXIS = np.linspace(0.0, 1.0, 5)
# Patches with a fainter contrast than this are not blown up to unit norm.
LEAST_NORM = 0.8


def describe_patches(
    attribute_kernels: npt.NDArray[np.floating[Any]], magnitude: npt.NDArray[np.float32], kernel: MatchKernel
) -> PatchDescriptors:
    """Descriptors of the patches of a crop.

    attribute_kernels: (w, h, a) float32, each pixel's attribute against the basis, columns of the crop first.
    magnitude: (h, w) float32 weights of the pixels, scaled by patch to unit norm.
    The kernel's spatial basis is the square of SPATIAL_AXIS, rows first. It separates, so columns are summed first
    and shared by the patches above each other.
    """
    height, width = magnitude.shape
    n_attributes, n_axis = attribute_kernels.shape[2], len(SPATIAL_AXIS)
    rows, columns = patch_corners(magnitude.shape, PATCH_PX)
    weighted = attribute_kernels * magnitude.T[:, :, None]
    flat = weighted.reshape(width, -1)
    position = (np.arange(PATCH_PX) / PATCH_PX)[:, None]
    axis = gaussian_kernel(position, SPATIAL_AXIS[:, None], kernel.spatial_gamma).T.astype(np.float32)
    energy = np.pad(np.cumsum(np.cumsum(magnitude.astype(np.float64) ** 2, 0), 1), ((1, 0), (1, 0)))
    sums = np.empty((len(rows), len(columns), n_attributes, n_axis, n_axis), dtype=np.float32)
    norms = np.empty((len(rows), len(columns)), dtype=np.float32)
    for c, left in enumerate(columns):
        right = left + PATCH_PX
        summed = (axis @ flat[left:right]).reshape(n_axis, height, n_attributes)
        along_x = np.ascontiguousarray(summed.transpose(1, 2, 0)).reshape(height, -1)
        for r, top in enumerate(rows):
            bottom = top + PATCH_PX
            patch = (axis @ along_x[top:bottom]).reshape(n_axis, n_attributes, n_axis)
            sums[r, c] = patch.transpose(1, 0, 2)
            square = energy[bottom, right] - energy[top, right] - energy[bottom, left] + energy[top, left]
            norms[r, c] = max(LEAST_NORM, np.sqrt(max(square, 0.0)))
    scaled = sums.reshape(-1, n_attributes, n_axis * n_axis) / norms.reshape(-1, 1, 1)
    return PatchDescriptors(
        kernel.project(scaled), centre_positions(rows, columns, PATCH_PX, magnitude.shape)
    )
