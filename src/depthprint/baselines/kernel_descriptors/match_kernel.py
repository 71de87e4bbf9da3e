"""Match kernels on a finite basis, and their kernel principal components."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from depthprint.errors import SettingsError

__all__ = ["MatchKernel", "gaussian_kernel", "gaussian_products", "grid_basis", "kpca_directions"]

FloatArray = npt.NDArray[np.floating[Any]]
Float32Array = npt.NDArray[np.float32]
Real = TypeVar("Real", bound=np.floating[Any])

# A product eigenvector that sums to less than this is centred already.
_CENTRED = 1e-12
# Eigenvalues that differ by less than this share of the largest are one, which a solver splits as it likes.
_EQUAL = 1e-9
# Entries over this share of the largest are large; no symmetric basis has entries at just this ratio.
_MAIN = 0.593
# Directions have a part below this outside the span that is kept of either basis: single precision rounds off more.
_SPANNED = 1e-6
# Numbers in single precision that a processor handles at once.
_LANES = 16


def gaussian_kernel(points: FloatArray, basis: FloatArray, gamma: float) -> FloatArray:
    """exp(-gamma ||p - b||^2) of points (n, d) against a basis (m, d): (n, m)."""
    squared = ((points[:, None, :] - basis[None, :, :]) ** 2).sum(-1)
    return np.asarray(np.exp(-gamma * squared))


def gaussian_products(points: npt.NDArray[Real], basis: FloatArray, gamma: float) -> npt.NDArray[Real]:
    """The kernel of many points (..., d) against a basis (m, d) by one product of matrices: (..., m), as precise.

    For points near the basis: what is squared cancels, so far from it the rounding would show.
    """
    squares = (points**2).sum(-1, keepdims=True)
    terms = np.concatenate([squares, points, np.ones_like(squares)], axis=-1)
    factors = np.vstack([np.ones(len(basis)), -2.0 * basis.T, (basis**2).sum(1)])
    exponents = terms.reshape(-1, terms.shape[-1]) @ (-gamma * factors).astype(points.dtype)
    np.minimum(exponents, 0.0, out=exponents)
    return np.asarray(np.exp(exponents).reshape(*points.shape[:-1], len(basis)))


def grid_basis(*axes: FloatArray) -> FloatArray:
    """All combinations of coordinates, (n, len(axes)), the last axis fastest."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def kpca_directions(attribute: FloatArray, spatial: FloatArray, dims: int) -> FloatArray:
    """Leading unit eigenvectors of the centred kernel of a product basis, (a, s, dims).

    attribute: (a, a) and spatial: (s, s) kernels of the two bases; the product's is their Kronecker product.
    That product's eigenvectors are products too, and centring mixes only those that do not sum to zero: these few
    are solved for, the rest are taken as they are, which is exact. Eigenspaces of several dimensions, which symmetric
    bases have many of, get a basis that does not depend on the solver, so that words learned on one machine fit the
    descriptors of another. Raises SettingsError for more dimensions than the basis has.
    Source: Schoelkopf, Smola and Mueller 1998; raw eigenvectors, as Bo, Ren and Fox 2010 use them.
    """
    a, s = len(attribute), len(spatial)
    if not 1 <= dims < a * s:
        raise SettingsError(f"kernel PCA: expected 1 to {a * s - 1} dimensions, got {dims}")
    values_a, vectors_a = _settled_eigenvectors(attribute)
    values_s, vectors_s = _settled_eigenvectors(spatial)
    values = np.outer(values_a, values_s).reshape(-1)
    mean = np.outer(vectors_a.sum(0), vectors_s.sum(0)).reshape(-1) / np.sqrt(a * s)
    mixed = np.flatnonzero(np.abs(mean) > _CENTRED)
    plain = np.flatnonzero(np.abs(mean) <= _CENTRED)
    u, d = mean[mixed], values[mixed]
    du = d * u
    block = np.diag(d) - np.outer(u, du) - np.outer(du, u) + np.outer(u, u) * (u @ du)
    block_values, block_vectors = _settled_eigenvectors(block)
    candidates = np.concatenate([values[plain], block_values])
    for group in _equal_values(candidates):
        candidates[group] = candidates[group].mean()
    order = np.argsort(-candidates, kind="stable")[:dims]
    coordinates = np.zeros((a * s, dims))
    for column, number in enumerate(order):
        if number < len(plain):
            coordinates[plain[number], column] = 1.0
        else:
            coordinates[mixed, column] = block_vectors[:, number - len(plain)]
    directions = np.einsum("ai,isk->ask", vectors_a, coordinates.reshape(a, s, dims), optimize=True)
    directions = np.einsum("st,atk->ask", vectors_s, directions, optimize=True)
    flat = directions.reshape(a * s, dims)
    return np.asarray((flat * _settled_signs(flat)).reshape(a, s, dims))


def _settled_eigenvectors(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rising eigenvalues (n,) and orthonormal eigenvectors (n, n) that rounding leaves as they are."""
    values, vectors = np.linalg.eigh(matrix)
    for group in _equal_values(values):
        values[group] = values[group].mean()
        vectors[:, group] = _settled_basis(vectors[:, group])
    return values, vectors


def _equal_values(values: FloatArray) -> list[npt.NDArray[np.int64]]:
    """Places of values (n,) that are equal but for rounding, group by group, rising."""
    order = np.argsort(values, kind="stable")
    apart = np.flatnonzero(np.diff(values[order]) > _EQUAL * np.abs(values).max()) + 1
    return np.split(order, apart)


def _settled_basis(basis: FloatArray) -> FloatArray:
    """The orthonormal basis (n, g) of the span of another that its projections of the axes, taken in turn, make."""
    settled = np.empty_like(basis)
    rest = basis
    for k in range(basis.shape[1]):
        lengths = (rest**2).sum(1)
        axis = rest[int(np.argmax(lengths > _MAIN * lengths.max()))]
        axis = axis / np.linalg.norm(axis)
        settled[:, k] = basis @ axis
        rest = rest - np.outer(rest @ axis, axis)
    return settled


def _settled_signs(columns: FloatArray) -> FloatArray:
    """Signs (k,) that make the first of the large entries of each column (n, k) positive."""
    large = np.abs(columns) > _MAIN * np.abs(columns).max(0)
    return np.asarray(np.sign(columns[large.argmax(0), np.arange(columns.shape[1])]))


@dataclass(frozen=True)
class MatchKernel:
    """A product basis and the directions that kernel evaluations against it are projected on.

    attribute: (a, d) points. spatial: (s, e) points. attribute_gamma, spatial_gamma: widths of the two kernels.
    directions: (a, s, k). Nearly all are products of one eigenvector of either basis, so few of these span them:
    attribute_span (a, p), spatial_span (s, q) and core (p, q, k) say the same. float32, read-only.
    """

    attribute: FloatArray
    spatial: FloatArray
    attribute_gamma: float
    spatial_gamma: float
    directions: Float32Array
    attribute_span: Float32Array
    spatial_span: Float32Array
    core: Float32Array

    @classmethod
    def build(
        cls,
        attribute: FloatArray,
        spatial: FloatArray,
        attribute_gamma: float,
        spatial_gamma: float,
        dims: int,
    ) -> MatchKernel:
        """Compute the directions of a basis; SettingsError for more than it has."""
        directions = kpca_directions(
            gaussian_kernel(attribute, attribute, attribute_gamma),
            gaussian_kernel(spatial, spatial, spatial_gamma),
            dims,
        )
        attribute_span, spatial_span = _span(directions), _span(directions.transpose(1, 0, 2))
        core = np.einsum("ap,sq,ask->pqk", attribute_span, spatial_span, directions, optimize=True)
        derived = [array.astype(np.float32) for array in (directions, attribute_span, spatial_span, core)]
        for array in (attribute, spatial, *derived):
            array.setflags(write=False)
        return cls(attribute, spatial, attribute_gamma, spatial_gamma, *derived)

    def padded(self, kernels: Float32Array) -> Float32Array:
        """Kernels (n, p) in the attribute's span with columns of zeros, up to a width that processors are made for."""
        p = kernels.shape[1]
        return np.pad(kernels, ((0, 0), (0, -p % _LANES)))

    @cached_property
    def _core_by_place(self) -> Float32Array:
        """The core (q p, k), places first, with the zeros of ``padded``."""
        p, _, k = self.core.shape
        core = np.pad(self.core, ((0, -p % _LANES), (0, 0), (0, 0)))
        return np.ascontiguousarray(core.transpose(1, 0, 2)).reshape(-1, k)

    def project_places(self, sums: Float32Array) -> Float32Array:
        """Descriptors (n, k) of sums (n, s, p): in the padded span, against each point of the spatial basis."""
        spanned = self.spatial_span.T @ sums
        return np.asarray(spanned.reshape(len(sums), len(self._core_by_place)) @ self._core_by_place)

    def project(self, sums: Float32Array) -> Float32Array:
        """Descriptors (n, k) of sums (n, p, q) float32 of kernel evaluations, each in its basis' span."""
        flat = self.core.reshape(-1, self.core.shape[2])
        return np.asarray(sums.reshape(len(sums), len(flat)) @ flat)


def _span(directions: FloatArray) -> FloatArray:
    """Orthonormal (n, p) that spans the first axis of directions (n, m, k) up to _SPANNED."""
    unfolded = directions.reshape(len(directions), -1)
    squares, vectors = np.linalg.eigh(unfolded @ unfolded.T)
    return np.asarray(vectors[:, squares > _SPANNED**2 * squares[-1]])
