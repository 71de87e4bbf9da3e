"""Simulated views that the package's own models learn from; no seed here is used by the demo or the evaluation."""

from __future__ import annotations

import numpy as np

from depthprint.range_image import RangeImage
from depthprint.simulation.objects import simulated_objects

__all__ = ["object_crops"]

_OBJECTS_SEED = 31


def object_crops(count: int) -> list[RangeImage]:
    """Masked crops of simulated objects, ``count`` views drawn from 90 objects."""
    objects = simulated_objects(n_categories=30, n_instances=3, frames=3, seed=_OBJECTS_SEED)
    chosen = np.random.default_rng(_OBJECTS_SEED).permutation(len(objects.views))[:count]
    return [objects.read(objects.views[i]) for i in np.sort(chosen)]
