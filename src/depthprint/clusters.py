"""Clusters: how the sparse model of an image becomes weighted appearances with positions (eq. 9-10)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.patches import Patches
from depthprint.settings import StreamSettings
from depthprint.sparse_coding import SparseModel

__all__ = ["Clusters", "cell_grid", "make_clusters"]

FloatArray = npt.NDArray[np.float64]

# Table 1: a sparse model has 20 atoms.
_MAX_PICKED = 20


@dataclass(frozen=True)
class Clusters:
    """Clusters before their appearance is brought to the ground space; one row a place of the grid.

    appearance: (m, a) float64, not normalised; a row of zeros is an empty cluster. Its columns are atoms and signs
        for 'cells', pixels for 'patches', and atoms for 'atoms', where a row names one signed atom.
    positions: (m, p) in [0, 1]. depth: (m,) mean relative depth.
    """

    appearance: FloatArray
    positions: FloatArray
    depth: FloatArray


def make_clusters(
    model: SparseModel, patches: Patches, atoms: FloatArray, stream: StreamSettings
) -> Clusters:
    """Turn the codes of one image's patches into clusters of the kind that the stream names."""
    coefficients = model.coefficients.astype(np.float64)
    if not stream.signed:
        coefficients = np.abs(coefficients)
    if stream.root:
        coefficients = np.sign(coefficients) * np.sqrt(np.abs(coefficients))
    if stream.clusters == "cells":
        return _cells(model, coefficients, patches, stream)
    if stream.clusters == "patches":
        return Clusters(_reconstruct(model, coefficients, atoms), patches.positions, patches.depth)
    return _picked_atoms(model, coefficients, patches, stream)


def cell_grid(stream: StreamSettings, dims: int) -> tuple[FloatArray, FloatArray]:
    """Centres (cells, dims) and half widths (cells,) of the stream's overlapping cells, in [0, 1]; read-only."""
    return _grid(stream.cells, stream.cell_overlap, dims)


@lru_cache(maxsize=32)
def _grid(cells: tuple[int, ...], overlap: float, dims: int) -> tuple[FloatArray, FloatArray]:
    centres, half_widths = [], []
    for n in cells:
        middle = (np.arange(n) + 0.5) / n
        places = np.stack(np.meshgrid(*([middle] * dims)), axis=-1).reshape(-1, dims)
        centres.append(places)
        half_widths.append(np.full(len(places), overlap * 0.5 / n))
    grid, widths = np.concatenate(centres), np.concatenate(half_widths)
    for array in (grid, widths):
        array.setflags(write=False)
    return grid, widths


def _cells(
    model: SparseModel, coefficients: FloatArray, patches: Patches, stream: StreamSettings
) -> Clusters:
    from depthprint._kernels.pooling import cell_means, max_pool_cells

    centres, half_widths = cell_grid(stream, patches.positions.shape[1])
    pooled = max_pool_cells(
        model.indptr, model.indices, coefficients, patches.positions, centres, half_widths,
        model.n_atoms, stream.signed,
    )  # fmt: skip
    depth = cell_means(model.indptr, patches.depth, patches.positions, centres, half_widths)
    return Clusters(pooled, centres, depth)


def _reconstruct(model: SparseModel, coefficients: FloatArray, atoms: FloatArray) -> FloatArray:
    from scipy.sparse import csr_matrix

    shape = (len(model.indptr) - 1, model.n_atoms)
    return np.asarray(csr_matrix((coefficients, model.indices, model.indptr), shape=shape) @ atoms)


def _picked_atoms(
    model: SparseModel, coefficients: FloatArray, patches: Patches, stream: StreamSettings
) -> Clusters:
    """The heaviest signed atoms of the image, each at the centroid of the patches that picked it."""
    patch = np.repeat(np.arange(len(model.indptr) - 1), np.diff(model.indptr))
    slot = model.indices + model.n_atoms * (coefficients < 0)
    n_slots = 2 * model.n_atoms
    mass = np.bincount(slot, np.abs(coefficients), n_slots)
    kept = np.argsort(-mass, kind="stable")[: _MAX_PICKED if stream.atoms == "patch" else stream.n_nonzero]
    kept = kept[mass[kept] > 0]

    def centroid(values: FloatArray) -> FloatArray:
        return np.bincount(slot, np.abs(coefficients) * values[patch], n_slots)[kept] / mass[kept]

    appearance = np.zeros((len(kept), model.n_atoms))
    sign = np.where(kept < model.n_atoms, 1.0, -1.0)
    appearance[np.arange(len(kept)), kept % model.n_atoms] = sign * mass[kept]
    positions = np.stack([centroid(axis) for axis in patches.positions.T], axis=1)
    return Clusters(appearance, positions, centroid(patches.depth))
