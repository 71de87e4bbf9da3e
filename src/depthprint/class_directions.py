"""The parts of a fused recogniser that are linear in a view's vectors, as one direction a class."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from depthprint.object_recogniser import FusedRecogniser
from depthprint.view_features import ViewFeatures

__all__ = ["ClassDirections"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ClassDirections:
    """What the discriminant and the support vector machine come to where kernels are products of short vectors.

    A score is a sum over the stored views of weight times product with the view's vector: the product with the
    weighted sum of these vectors, which the stored views alone make. codes, complexities, surfaces, pairs, machine:
    (r, c) each, of c classes, read-only; the latter three None where surfaces are not compared. offsets: (c,).
    """

    codes: FloatArray
    complexities: FloatArray
    surfaces: FloatArray | None
    pairs: FloatArray | None
    machine: FloatArray | None
    offsets: FloatArray

    def __post_init__(self) -> None:
        for array in (getattr(self, field.name) for field in fields(self)):
            if array is not None:
                array.setflags(write=False)

    @classmethod
    def of(cls, stored: ViewFeatures, fused: FusedRecogniser) -> ClassDirections:
        """Directions of a recogniser fitted to how the stored views compare among themselves."""
        weights, offsets = fused.discriminant
        # A copy of a view that has a surface alone is for the others the view itself.
        of_views = weights.reshape(-1, len(stored), weights.shape[1]).sum(axis=0)
        total = sum(stored.shares.values())
        shares = {name: share / total for name, share in stored.shares.items()}
        surfaces, pairs, machine = None, None, None
        if stored.surface_sums is not None:
            of_surfaces, of_pairs = stored.surface_sums
            surfaces = shares["surfaces"] * (of_surfaces.T @ weights)
            pairs = shares["pairs"] * (of_pairs.T @ weights)
        known = stored.known_to_machine
        if known is not None and fused.multipliers is not None:
            machine = np.asarray(known.T @ fused.multipliers.astype(np.float64), dtype=np.float64)
        return cls(
            shares["codes"] * (stored.code_sums.T @ of_views),
            shares["complexities"] * (stored.landmark.T @ of_views),
            surfaces,
            pairs,
            machine,
            offsets,
        )

    def scores(self, views: ViewFeatures) -> tuple[FloatArray, FloatArray | None]:
        """Scores (m, c) of views by the discriminant, and by the machine where there is one."""
        total = views.code_sums @ self.codes + views.landmark @ self.complexities + self.offsets
        sums, rows = views.surface_sums, views.machine_rows
        if self.surfaces is None or self.pairs is None or sums is None or rows is None:
            return total, None
        total = total + sums[0] @ self.surfaces + sums[1] @ self.pairs
        return total, None if self.machine is None else np.asarray(rows @ self.machine)
