"""Train the models that the package ships, on simulated worlds alone: tools/train_shipped_models.py [PRESET ...].

No seed here is used by the demo, the tests or the evaluation.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from depthprint.datasets.base import RangeSequence
from depthprint.datasets.simulated_street import simulated_street
from depthprint.encoder import Encoder
from depthprint.range_image import RangeImage
from depthprint.simulation.training import object_crops
from depthprint.surface_words import SHIPPED, SurfaceWords

MODELS = Path(__file__).parents[1] / "src" / "depthprint" / "models"
TOWNS = (11, 12, 13)
ROOMS = 21
SURFACES = SHIPPED.stem


def spread(sequence: RangeSequence, count: int) -> list[RangeImage]:
    """Take ``count`` frames evenly from a sequence."""
    return [sequence[int(i)] for i in np.linspace(0, len(sequence) - 1, count)]


def street_frames(sensor: str, count: int) -> list[RangeImage]:
    """Frames of all training towns."""
    share = count // len(TOWNS)
    return [f for seed in TOWNS for f in spread(simulated_street(seed=seed, sensor=sensor), share)]


def room_frames(count: int) -> list[RangeImage]:
    """Frames of furnished rooms, seen by a hand-held camera."""
    from depthprint.simulation.rooms import simulated_rooms

    return spread(simulated_rooms(n_frames=2 * count, seed=ROOMS), count)


TRAINING = {
    "literal": lambda: street_frames("stereo", 420) + room_frames(300) + object_crops(300),
    "object": lambda: object_crops(400),
    "street": lambda: street_frames("stereo", 300),
    "handheld": lambda: room_frames(240),
    "lidar": lambda: street_frames("lidar", 240),
    "laser": lambda: street_frames("laser", 600),
}


def train(preset: str) -> tuple[Path, int]:
    """Train and save one model; its path, and how many simulated images it learned from."""
    if preset == SURFACES:
        images = object_crops(400)
        return SurfaceWords.learn(images).save(SHIPPED), len(images)
    images = TRAINING[preset]()
    return Encoder.from_preset(preset).fit(images).save(MODELS / f"{preset}.npz"), len(images)


def main(presets: Sequence[str]) -> None:
    """Train and save the named presets, all by default."""
    MODELS.mkdir(exist_ok=True)
    for preset in presets or (*TRAINING, SURFACES):
        started = time.perf_counter()
        path, count = train(preset)
        seconds = time.perf_counter() - started
        print(f"{path.name}: {count} simulated images, {path.stat().st_size // 1024} KiB, {seconds:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
