"""The parts of a fused recogniser that are linear in a view's vectors, as one direction a class."""

from __future__ import annotations

from dataclasses import dataclass

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
    weighted sum of these vectors, which the stored views alone make. codes, complexities, surfaces, machine: (r, c)
    each, of c classes, read-only; the latter two None where surfaces are not compared. offsets: (c,).
    """

    codes: FloatArray
    complexities: FloatArray
    surfaces: FloatArray | None
    machine: FloatArray | None
    offsets: FloatArray

    def __post_init__(self) -> None:
        for array in (self.codes, self.complexities, self.surfaces, self.machine, self.offsets):
            if array is not None:
                array.setflags(write=False)

    @classmethod
    def of(cls, stored: ViewFeatures, fused: FusedRecogniser) -> ClassDirections:
        """Directions of a recogniser fitted to how the stored views compare among themselves."""
        weights, offsets = fused.discriminant
        # A copy of a view that has a surface alone is for the others the view itself.
        of_views = weights.reshape(-1, len(stored), weights.shape[1]).sum(axis=0)
        sides = stored.surface_sums
        total = sum(stored.shares.values())
        shares = {name: share / total for name, share in stored.shares.items()}
        known, machine = stored.known_surfaces, None
        if known is not None and fused.multipliers is not None:
            machine = np.asarray(known.T @ fused.multipliers.astype(np.float64), dtype=np.float64)
        return cls(
            shares["codes"] * (stored.code_sums.T @ of_views),
            shares["complexities"] * (stored.landmark.T @ of_views),
            None if sides is None else shares["surfaces"] * (sides.T @ weights),
            machine,
            offsets,
        )

    def scores(self, views: ViewFeatures) -> tuple[FloatArray, FloatArray | None]:
        """Scores (m, c) of views by the discriminant, and by the machine where there is one."""
        total = views.code_sums @ self.codes + views.landmark @ self.complexities + self.offsets
        if self.surfaces is None or views.surface is None or views.surface_sums is None:
            return total, None
        machine = None if self.machine is None else np.asarray(views.surface @ self.machine)
        return total + views.surface_sums @ self.surfaces, machine
