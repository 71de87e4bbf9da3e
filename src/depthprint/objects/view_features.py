"""Views of objects as short vectors, and how these compare."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.objects.fused_recogniser import KERNEL_SHARES, ViewComparison, fused_comparison
from depthprint.objects.kernels import unit_rows

__all__ = ["FEW_ROWS", "ViewFeatures", "few_products"]

Float32Array = npt.NDArray[np.float32]

# So many rows or fewer are multiplied with each row of a matrix read once, and none that only zeros would meet.
FEW_ROWS = 8
_BLOCK_ROWS = 256


@dataclass(frozen=True)
class _Sides:
    """Unit vectors (n, r) of views, and of their mirror images, None where these always have the same ones."""

    straight: Float32Array
    mirrored: Float32Array | None

    @cached_property
    def sums(self) -> Float32Array:
        """Unit vectors of the sums of both."""
        return self.straight if self.mirrored is None else unit_rows(self.straight + self.mirrored)

    @cached_property
    def _columns(self) -> Float32Array:
        """The straight vectors as columns, (r, n)."""
        return np.ascontiguousarray(self.straight.T)

    def kernel_with(self, stored: _Sides) -> Float32Array:
        """Products (m, n) of the sums of views and mirror images."""
        return self.sums @ stored.sums.T

    def distances_to(self, stored: _Sides) -> Float32Array:
        """One minus the cosine of the nearer (m, n), of a view or of its mirror image."""
        sides = [self.straight] if self.mirrored is None else [self.straight, self.mirrored]
        if 2 * len(self.straight) <= FEW_ROWS:
            products = few_products(np.concatenate(sides), stored._columns)
            cosine = np.maximum.reduce(np.split(products, len(sides)))
        else:
            cosine = np.maximum.reduce([side @ stored.straight.T for side in sides])
        if self is stored:
            cosine = np.maximum(cosine, cosine.T)
        return np.asarray(np.maximum(1.0 - cosine, 0.0))

    def scales(self, m: int) -> npt.NDArray[np.float64]:
        """Distance (n,) of each view to the m-th nearest other one, without a matrix of all pairs."""
        found = np.empty(len(self.straight))
        for start in range(0, len(found), _BLOCK_ROWS):
            rows = np.arange(start, min(start + _BLOCK_ROWS, len(found)))
            cosine = self.straight[rows] @ self.straight.T
            if self.mirrored is not None:
                cosine = np.maximum(cosine, self.mirrored[rows] @ self.straight.T)
                cosine = np.maximum(cosine, self.straight[rows] @ self.mirrored.T)
            cosine[rows - start, rows] = -np.inf
            found[rows] = np.maximum(1.0 + np.partition(-cosine, m - 1, axis=1)[:, m - 1], 0.0)
        return found


@dataclass(frozen=True)
class ViewFeatures:
    """Views as short vectors, (n, r) each, read-only.

    straight, mirrored: unit pooled codes along the leading directions; ``mirrored`` equals ``straight`` where the
    preset does not mirror. landmark: unit features of the information distance to the landmarks. surface,
    mirrored_surface: unit surface vectors along theirs, or None where surfaces are not compared; pairs: those of the
    pairs of points, which mirror images have alike. partial, mirrored_partial, partial_pairs: those of partly hidden
    copies of the views, where these are learned from.
    """

    straight: Float32Array
    mirrored: Float32Array
    landmark: Float32Array
    surface: Float32Array | None = None
    mirrored_surface: Float32Array | None = None
    pairs: Float32Array | None = None
    partial: Float32Array | None = None
    mirrored_partial: Float32Array | None = None
    partial_pairs: Float32Array | None = None

    def __post_init__(self) -> None:
        for array in (self.straight, self.mirrored, self.landmark, *self._surfaces()):
            if array is not None:
                array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.straight)

    def _surfaces(self) -> tuple[Float32Array | None, ...]:
        return (
            self.surface,
            self.mirrored_surface,
            self.pairs,
            self.partial,
            self.mirrored_partial,
            self.partial_pairs,
        )

    @cached_property
    def _codes(self) -> _Sides:
        return _Sides(self.straight, self.mirrored)

    @cached_property
    def _surface_sides(self) -> tuple[_Sides, _Sides] | None:
        """Surface vectors of the views, and their pairs of points."""
        if self.surface is None or self.mirrored_surface is None or self.pairs is None:
            return None
        return _Sides(self.surface, self.mirrored_surface), _Sides(self.pairs, None)

    @cached_property
    def _with_copies(self) -> tuple[_Sides, _Sides] | None:
        """The same, followed by those of the partial copies."""
        copies = self.partial, self.mirrored_partial, self.partial_pairs
        views = self.surface, self.mirrored_surface, self.pairs
        joined = [
            np.concatenate([view, copy])
            for view, copy in zip(views, copies, strict=True)
            if view is not None and copy is not None
        ]
        if len(joined) < len(copies):
            return self._surface_sides
        straight, mirrored, pairs = joined
        return _Sides(straight, mirrored), _Sides(pairs, None)

    @cached_property
    def machine_rows(self) -> Float32Array | None:
        """Surface vectors beside pairs of points, (n, r), as the machine weighs them: alike."""
        if self.surface is None or self.pairs is None:
            return None
        return _beside(self.surface, self.pairs)

    @cached_property
    def known_to_machine(self) -> Float32Array | None:
        """The same of the views, then of their mirror images: what the machine learns from."""
        if self.machine_rows is None or self.mirrored_surface is None or self.pairs is None:
            return None
        return np.concatenate([self.machine_rows, _beside(self.mirrored_surface, self.pairs)])

    @property
    def shares(self) -> dict[str, float]:
        """Weights, in the sum of kernels, of what is known of the views."""
        known = ["codes", "complexities"]
        if self._surface_sides is not None:
            known += ["surfaces", "pairs"]
        return {name: KERNEL_SHARES[name] for name in known}

    def taken(self, rows: npt.NDArray[np.integer]) -> ViewFeatures:
        """Some of the views."""
        surfaces = (None if array is None else array[rows] for array in self._surfaces())
        return ViewFeatures(self.straight[rows], self.mirrored[rows], self.landmark[rows], *surfaces)

    @property
    def code_sums(self) -> Float32Array:
        """Unit vectors (n, r) of the sums of the codes of views and of their mirror images."""
        return self._codes.sums

    @property
    def surface_sums(self) -> tuple[Float32Array, Float32Array] | None:
        """Those of the surface vectors and of the pairs, None where surfaces are not compared."""
        return None if self._surface_sides is None else _sums(*self._surface_sides)

    @property
    def learned_sums(self) -> tuple[Float32Array, Float32Array] | None:
        """The same, followed by those of the partial copies where there are any."""
        return None if self._with_copies is None else _sums(*self._with_copies)

    def compared_with(self, stored: ViewFeatures) -> ViewComparison:
        """Kernel values and distances (m, n) to other views."""
        near = self.distances_to(stored)
        parts = [
            ViewComparison(self._codes.kernel_with(stored._codes), near[:1]),
            ViewComparison(self.landmark @ stored.landmark.T),
        ]
        for (sides, others), distances in zip(self._sides_against(stored), near[1:], strict=True):
            parts.append(ViewComparison(sides.kernel_with(others), (distances,)))
        known, asked = stored.known_to_machine, self.machine_rows
        if known is not None and asked is not None:
            parts[-1] = replace(parts[-1], machine_kernel=(known if self is stored else asked) @ known.T)
        return fused_comparison(parts, list(self.shares.values()))

    def distances_to(self, stored: ViewFeatures) -> tuple[Float32Array, ...]:
        """Distances (m, n) to other views by codes; and (m, k n) by surfaces and by pairs where these are compared."""
        from depthprint._kernels.tasks import run_tasks

        compared = [(self._codes, stored._codes), *self._sides_against(stored)]
        near: dict[int, Float32Array] = {}

        def compare(number: int) -> None:
            sides, others = compared[number]
            near[number] = sides.distances_to(others)

        run_tasks([partial(compare, number) for number in range(len(compared))])
        return tuple(near[number] for number in range(len(compared)))

    def neighbour_scales(self, m: int) -> tuple[npt.NDArray[np.float64], ...]:
        """Distance (k n,) of each view to its m-th nearest other one, as ``distances_to`` has them, part by part."""
        return tuple(sides.scales(m) for sides in (self._codes, *(self._with_copies or ())))

    def _sides_against(self, stored: ViewFeatures) -> list[tuple[_Sides, _Sides]]:
        """Surfaces to compare: among themselves views have all copies; others ask for none of theirs."""
        sides = self._with_copies if self is stored else self._surface_sides
        if sides is None:
            return []
        if stored._with_copies is None:
            raise DataError("views: expected stored views with surface vectors, got some without")
        return list(zip(sides, stored._with_copies, strict=True))


def _sums(surfaces: _Sides, pairs: _Sides) -> tuple[Float32Array, Float32Array]:
    return surfaces.sums, pairs.sums


def _beside(surfaces: Float32Array, pairs: Float32Array) -> Float32Array:
    """Unit rows of both, of equal weight in products."""
    return np.concatenate([surfaces, pairs], axis=1) * np.float32(0.5**0.5)


def few_products(rows: Float32Array, matrix: Float32Array) -> Float32Array:
    """Product (n, r) of up to FEW_ROWS rows (n, d) and a matrix (d, r)."""
    from depthprint._kernels.sparse_rows import sparse_products

    return np.asarray(sparse_products(rows, matrix))
