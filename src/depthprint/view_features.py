"""Views of objects as short vectors, and how these compare."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.object_kernels import unit_rows
from depthprint.object_recogniser import KERNEL_SHARES, ViewComparison, fused_comparison

__all__ = ["FEW_ROWS", "ViewFeatures", "few_products"]

Float32Array = npt.NDArray[np.float32]

# So many rows or fewer are multiplied with each row of a matrix read once, and none that only zeros would meet.
FEW_ROWS = 8


@dataclass(frozen=True)
class _Sides:
    """Unit vectors (n, r) of views and of their mirror images."""

    straight: Float32Array
    mirrored: Float32Array

    @cached_property
    def sums(self) -> Float32Array:
        """Unit vectors of the sums of both."""
        return unit_rows(self.straight + self.mirrored)

    @cached_property
    def _columns(self) -> Float32Array:
        """The straight vectors as columns, (r, n)."""
        return np.ascontiguousarray(self.straight.T)

    def kernel_with(self, stored: _Sides) -> Float32Array:
        """Products (m, n) of the sums of views and mirror images."""
        return self.sums @ stored.sums.T

    def distances_to(self, stored: _Sides) -> Float32Array:
        """One minus the cosine of the nearer (m, n), of a view or of its mirror image."""
        if 2 * len(self.straight) <= FEW_ROWS:
            both = few_products(np.concatenate([self.straight, self.mirrored]), stored._columns)
            cosine = np.maximum(*np.split(both, 2))
        else:
            cosine = np.maximum(self.straight @ stored.straight.T, self.mirrored @ stored.straight.T)
        if self is stored:
            cosine = np.maximum(cosine, cosine.T)
        return np.maximum(1.0 - cosine, 0.0)


@dataclass(frozen=True)
class ViewFeatures:
    """Views as short vectors, (n, r) each, read-only.

    straight, mirrored: unit pooled codes along the leading directions; ``mirrored`` equals ``straight`` where the
    preset does not mirror. landmark: unit features of the information distance to the landmarks. surface,
    mirrored_surface: unit surface vectors along theirs, or None where surfaces are not compared. partial,
    mirrored_partial: those of partly hidden copies of the views, where these are learned from.
    """

    straight: Float32Array
    mirrored: Float32Array
    landmark: Float32Array
    surface: Float32Array | None = None
    mirrored_surface: Float32Array | None = None
    partial: Float32Array | None = None
    mirrored_partial: Float32Array | None = None

    def __post_init__(self) -> None:
        for array in (self.straight, self.mirrored, self.landmark, *self._surfaces()):
            if array is not None:
                array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.straight)

    def _surfaces(self) -> tuple[Float32Array | None, ...]:
        return self.surface, self.mirrored_surface, self.partial, self.mirrored_partial

    @cached_property
    def _codes(self) -> _Sides:
        return _Sides(self.straight, self.mirrored)

    @cached_property
    def _surface_sides(self) -> _Sides | None:
        if self.surface is None or self.mirrored_surface is None:
            return None
        return _Sides(self.surface, self.mirrored_surface)

    @cached_property
    def _with_copies(self) -> _Sides | None:
        """Surface vectors of the views, then of their partial copies, and those of their mirror images."""
        if self.partial is None or self.mirrored_partial is None or self._surface_sides is None:
            return self._surface_sides
        views = self._surface_sides
        return _Sides(
            np.concatenate([views.straight, self.partial]),
            np.concatenate([views.mirrored, self.mirrored_partial]),
        )

    @cached_property
    def known_surfaces(self) -> Float32Array | None:
        """Surface vectors of the views, then of their mirror images: what the machine learns from."""
        if self._surface_sides is None:
            return None
        return np.concatenate([self._surface_sides.straight, self._surface_sides.mirrored])

    @property
    def shares(self) -> dict[str, float]:
        """Weights, in the sum of kernels, of what is known of the views."""
        shares = {name: KERNEL_SHARES[name] for name in ("codes", "complexities")}
        if self._surface_sides is not None:
            shares["surfaces"] = KERNEL_SHARES["surfaces"]
        return shares

    def taken(self, rows: npt.NDArray[np.integer]) -> ViewFeatures:
        """Some of the views."""
        surfaces = (None if array is None else array[rows] for array in self._surfaces())
        return ViewFeatures(self.straight[rows], self.mirrored[rows], self.landmark[rows], *surfaces)

    @property
    def code_sums(self) -> Float32Array:
        """Unit vectors (n, r) of the sums of the codes of views and of their mirror images."""
        return self._codes.sums

    @property
    def surface_sums(self) -> Float32Array | None:
        """Those of the surface vectors, followed by those of partial copies where these are learned from."""
        return None if self._with_copies is None else self._with_copies.sums

    def compared_with(self, stored: ViewFeatures) -> ViewComparison:
        """Kernel values and distances (m, n) to other views."""
        near = self.distances_to(stored)
        parts = [
            ViewComparison(self._codes.kernel_with(stored._codes), near[:1]),
            ViewComparison(self.landmark @ stored.landmark.T),
        ]
        sides, others = self._sides_against(stored)
        known = stored.known_surfaces
        if sides is not None and others is not None and known is not None:
            machine = (known if self is stored else sides.straight) @ known.T
            parts.append(ViewComparison(sides.kernel_with(others), near[1:], machine))
        return fused_comparison(parts, list(self.shares.values()))

    def distances_to(self, stored: ViewFeatures) -> tuple[Float32Array, ...]:
        """Distances (m, n) to other views by their codes, and (m, k n) by surfaces where these are compared."""
        near = self._codes.distances_to(stored._codes)
        sides, others = self._sides_against(stored)
        return (near,) if sides is None or others is None else (near, sides.distances_to(others))

    def _sides_against(self, stored: ViewFeatures) -> tuple[_Sides | None, _Sides | None]:
        """Surfaces to compare: among themselves views have all copies; others ask for none of theirs."""
        sides = self._with_copies if self is stored else self._surface_sides
        if sides is not None and stored._with_copies is None:
            raise DataError("views: expected stored views with surface vectors, got some without")
        return sides, stored._with_copies


def few_products(rows: Float32Array, matrix: Float32Array) -> Float32Array:
    """Product (n, r) of up to FEW_ROWS rows (n, d) and a matrix (d, r)."""
    from depthprint._kernels.sparse_rows import sparse_products

    return np.asarray(sparse_products(rows, matrix))
