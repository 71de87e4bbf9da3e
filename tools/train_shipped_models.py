"""Train the models that the package ships, on simulated worlds alone: tools/train_shipped_models.py [PRESET ...].

No seed here is used by the demo, the tests or the evaluation.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

from depthprint.encoder import Encoder
from depthprint.objects.surface_words import SHIPPED, SurfaceWords
from depthprint.presets import PRESETS
from depthprint.simulation.training import object_crops, training_images

MODELS = Path(__file__).parents[1] / "src" / "depthprint" / "models"
SURFACES = SHIPPED.stem


def train(preset: str) -> tuple[Path, int]:
    """Train and save one model; its path, and how many simulated images it learned from."""
    if preset == SURFACES:
        images = object_crops(400)
        return SurfaceWords.learn(images).save(SHIPPED), len(images)
    images = training_images(preset)
    return Encoder.from_preset(preset).fit(images).save(MODELS / f"{preset}.npz"), len(images)


def main(presets: Sequence[str]) -> None:
    """Train and save the named presets, all by default."""
    MODELS.mkdir(exist_ok=True)
    for preset in presets or (*PRESETS, SURFACES):
        started = time.perf_counter()
        path, count = train(preset)
        seconds = time.perf_counter() - started
        print(f"{path.name}: {count} simulated images, {path.stat().st_size // 1024} KiB, {seconds:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
