"""LearnedClasses: what a recogniser has learned of its classes, in the form that queries ask and files keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.objects.class_directions import ClassDirections
from depthprint.objects.fused_recogniser import LOCAL_SCALING, FusedRecogniser, JoinedScores, nearest_weights
from depthprint.objects.view_features import ViewFeatures

__all__ = ["MOST_IN_PAIRS", "LearnedClasses"]

FloatArray = npt.NDArray[np.float64]

# Pairs of so many views take 1 GB to compare.
MOST_IN_PAIRS = 2000

_SCALES = "neighbour_scales_"
_WEIGHTS = "nearest_weights"
_DIRECTIONS = ("codes", "complexities", "surfaces", "pairs", "machine", "offsets")


@dataclass(frozen=True, eq=False)
class LearnedClasses:
    """Labels (c,), sorted; what scores have that is linear in a view's vectors, and how it joins with nearest views."""

    labels: npt.NDArray[Any]
    directions: ClassDirections
    joined: JoinedScores

    @classmethod
    def fit(cls, stored: ViewFeatures, labels: Sequence[str] | npt.NDArray[Any]) -> LearnedClasses:
        """Learn from how the stored views compare among themselves, and their labels (n,).

        More than MOST_IN_PAIRS are not compared in all pairs: the same is then learned from their vectors.
        """
        weights = nearest_weights(list(stored.shares))
        if len(stored) > MOST_IN_PAIRS:
            classes, numbers = np.unique(np.asarray(labels), return_inverse=True)
            scales = stored.neighbour_scales(min(LOCAL_SCALING, len(stored) - 1))
            joined = JoinedScores.of_scales(scales, np.asarray(labels), weights)
            return cls(classes, ClassDirections.learned(stored, numbers), joined)
        fused = FusedRecogniser(nearest_weights=weights).fit(stored.compared_with(stored), np.asarray(labels))
        return cls(fused.labels, ClassDirections.of(stored, fused), fused.joined)

    def scores(self, views: ViewFeatures, distances: Sequence[npt.NDArray[np.floating[Any]]]) -> FloatArray:
        """Scores (m, c) of views, whose distances to the stored ones are ``ViewFeatures.distances_to``."""
        return self.joined.of(*self.directions.scores(views), distances)

    def parts(self) -> dict[str, npt.NDArray[Any]]:
        """Arrays for a file; ``of_parts`` gives the same scores from them, to the bit."""
        directions = {f"class_{name}": getattr(self.directions, name) for name in _DIRECTIONS}
        scales = {f"{_SCALES}{k}": one for k, one in enumerate(self.joined.scales)}
        kept = directions | scales | {_WEIGHTS: np.asarray(self.joined.weights)}
        return {name: array for name, array in kept.items() if array is not None}

    @classmethod
    def of_parts(cls, arrays: Mapping[str, npt.NDArray[Any]], labels: Sequence[str]) -> LearnedClasses:
        """What was learned of views with these labels (n,). Raises DataError for parts that do not fit each other."""
        known = np.asarray(labels)
        classes = np.unique(known)
        directions = ClassDirections(
            codes=arrays["class_codes"],
            complexities=arrays["class_complexities"],
            surfaces=arrays.get("class_surfaces"),
            pairs=arrays.get("class_pairs"),
            machine=arrays.get("class_machine"),
            offsets=arrays["class_offsets"],
        )
        for name in _DIRECTIONS:
            array = getattr(directions, name)
            if array is not None and array.shape[-1] != len(classes):
                raise DataError(
                    f"class_{name}: expected columns of {len(classes)} classes, got shape {array.shape}"
                )
        scales: list[FloatArray] = []
        while f"{_SCALES}{len(scales)}" in arrays:
            scales.append(arrays[f"{_SCALES}{len(scales)}"])
        weights = tuple(arrays[_WEIGHTS].tolist())
        if len(weights) != len(scales):
            raise DataError(f"{_WEIGHTS}: expected one for each of {len(scales)} scales, got {len(weights)}")
        return cls(classes, directions, JoinedScores.of_scales(scales, known, weights))
