"""Learn an encoder from a recording, and save it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from depthprint.errors import SettingsError
from depthprint.range_image import RangeImage
from depthprint.runs.source import DataSource, spread
from depthprint.runs.stages import Stages, silent

__all__ = ["TrainedModel", "run_train"]

MAX_TRAINING_IMAGES = 400


@dataclass(frozen=True)
class TrainedModel:
    """Where the model is, what it learned from, and its fingerprint."""

    path: Path
    preset: str
    data: str
    n_images: int
    fingerprint: str


def run_train(
    source: DataSource, out: Path, *, preset: str | None = None, seed: int = 0, stages: Stages = silent
) -> TrainedModel:
    """Fit an encoder on at most 400 images, evenly spread over the data, and write it to one file.

    The preset defaults to the one that suits the data; with ``object`` the data is a set of object views. Raises
    DataError, SettingsError as its parts do; the file appears only when training ended well.
    """
    from depthprint.encoder import Encoder

    images: Sequence[RangeImage]
    if preset == "object" or source.dataset_name == "uw_rgbd_object":
        name, images, suited = _object_images(source, stages)
    else:
        sequence = source.open(stages("make the world"))
        name, suited = sequence.name, sequence.preset
        progress = stages("read")
        chosen = spread(len(sequence), MAX_TRAINING_IMAGES)
        images = []
        for done, index in enumerate(chosen):
            images.append(sequence[index])
            progress(done + 1, len(chosen))
    encoder = Encoder.from_preset(preset or suited, seed=seed).fit(images, stages("train"))
    path = encoder.save(out)
    return TrainedModel(path, encoder.settings.name, name, len(images), encoder.fingerprint)


def _object_images(source: DataSource, stages: Stages) -> tuple[str, list[RangeImage], str]:
    if source.path is None:
        raise SettingsError("the preset 'object' learns from object views: expected DATA, a folder of them")
    from depthprint.datasets.registry import open_objects

    objects = open_objects(source.path)
    progress = stages("read")
    chosen = spread(len(objects.views), MAX_TRAINING_IMAGES)
    images = []
    for done, index in enumerate(chosen):
        images.append(objects.read(objects.views[index]))
        progress(done + 1, len(chosen))
    return objects.name, images, "object"
