"""The parts of a fused recogniser that are linear in a view's vectors, as one direction a class."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.baselines.linear_svm import linear_directions
from depthprint.objects.discriminant import discriminant_directions
from depthprint.objects.fused_recogniser import MACHINE_C, SHRINKAGE, FusedRecogniser
from depthprint.objects.view_features import ViewFeatures

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
        if stored.learned_sums is not None:
            of_surfaces, of_pairs = stored.learned_sums
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

    @classmethod
    def learned(cls, stored: ViewFeatures, numbers: npt.NDArray[np.integer[Any]]) -> ClassDirections:
        """The same from the vectors of the stored views and the number of each one's class, without all pairs of them.

        Raises ConvergenceError where the machine does not come near its optimum.
        """
        rows, splits, weights = _weighed_rows(stored)
        copies = len(rows) // len(stored)
        directions, offsets = discriminant_directions(rows, np.tile(numbers, copies), SHRINKAGE)
        parts = [weight * part for weight, part in zip(weights, np.split(directions, splits), strict=True)]
        surfaces, pairs = parts[2:] if len(parts) > 2 else (None, None)
        known = stored.known_to_machine
        machine = None if known is None else linear_directions(known, np.tile(numbers, 2), MACHINE_C)
        return cls(parts[0], parts[1], surfaces, pairs, machine, offsets)

    def scores(self, views: ViewFeatures) -> tuple[FloatArray, FloatArray | None]:
        """Scores (m, c) of views by the discriminant, and by the machine where there is one."""
        total = views.code_sums @ self.codes + views.landmark @ self.complexities + self.offsets
        sums, rows = views.surface_sums, views.machine_rows
        if self.surfaces is None or self.pairs is None or sums is None or rows is None:
            return total, None
        total = total + sums[0] @ self.surfaces + sums[1] @ self.pairs
        return total, None if self.machine is None else np.asarray(rows @ self.machine)


def _weighed_rows(stored: ViewFeatures) -> tuple[FloatArray, list[int], list[float]]:
    """Rows whose products are the fused kernel; where its parts begin after the first, and the weights in them."""
    total = sum(stored.shares.values())
    weights = [math.sqrt(share / total) for share in stored.shares.values()]
    parts = [stored.code_sums, stored.landmark, *(stored.learned_sums or ())]
    n_rows = max(map(len, parts))
    rows = [
        weight * np.tile(part.astype(np.float64), (n_rows // len(part), 1))
        for weight, part in zip(weights, parts, strict=True)
    ]
    return np.concatenate(rows, axis=1), np.cumsum([part.shape[1] for part in parts])[:-1].tolist(), weights
