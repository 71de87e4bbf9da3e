"""Simulated views that the package's own models learn from; no seed here is used by the demo or the evaluation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from depthprint.datasets.base import RangeSequence
from depthprint.errors import SettingsError
from depthprint.range_image import RangeImage

__all__ = ["object_crops", "room_frames", "spread_frames", "street_frames", "training_images"]

_OBJECTS_SEED = 31
_TOWN_SEEDS = (11, 12, 13)
_ROOMS_SEED = 21


def training_images(preset: str) -> list[RangeImage]:
    """The simulated images that the shipped model of a preset learned from; SettingsError for an unknown preset."""
    if preset not in _TRAINING:
        raise SettingsError(f"preset: expected one of {', '.join(_TRAINING)}, got {preset!r}")
    return _TRAINING[preset]()


def object_crops(count: int) -> list[RangeImage]:
    """Masked crops of simulated objects, ``count`` views drawn from 90 objects."""
    from depthprint.simulation.objects import simulated_objects

    objects = simulated_objects(n_categories=30, n_instances=3, frames=3, seed=_OBJECTS_SEED)
    chosen = np.random.default_rng(_OBJECTS_SEED).permutation(len(objects.views))[:count]
    return [objects.read(objects.views[i]) for i in np.sort(chosen)]


def street_frames(sensor: str, count: int) -> list[RangeImage]:
    """Frames of all training towns."""
    from depthprint.datasets.simulated_street import simulated_street

    share = count // len(_TOWN_SEEDS)
    return [
        f for seed in _TOWN_SEEDS for f in spread_frames(simulated_street(seed=seed, sensor=sensor), share)
    ]


def room_frames(count: int) -> list[RangeImage]:
    """Frames of furnished rooms, seen by a hand-held camera."""
    from depthprint.simulation.rooms import simulated_rooms

    return spread_frames(simulated_rooms(n_frames=2 * count, seed=_ROOMS_SEED), count)


def spread_frames(sequence: RangeSequence, count: int) -> list[RangeImage]:
    """Take ``count`` frames evenly from a sequence, all where it has no more."""
    return [sequence[int(i)] for i in np.linspace(0, len(sequence) - 1, min(count, len(sequence)))]


_TRAINING: dict[str, Callable[[], list[RangeImage]]] = {
    "literal": lambda: street_frames("stereo", 420) + room_frames(300) + object_crops(300),
    "object": lambda: object_crops(400),
    "street": lambda: street_frames("stereo", 300),
    "handheld": lambda: room_frames(240),
    "lidar": lambda: street_frames("lidar", 240),
    "laser": lambda: street_frames("laser", 600),
}
