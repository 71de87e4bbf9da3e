"""Learn a recogniser from labelled views, save it, and ask it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from depthprint.runs.depth_files import labelled_files, read_labelled, read_view
from depthprint.runs.models import require_model
from depthprint.runs.stages import Stages, silent

if TYPE_CHECKING:
    from depthprint.objects.trained_recogniser import Recognition

__all__ = ["TrainedObjects", "run_recognise", "run_train_objects"]


@dataclass(frozen=True)
class TrainedObjects:
    """Where the recogniser is, and what it learned from."""

    path: Path
    preset: str
    classes: tuple[str, ...]
    n_views: int
    knows_unknown: bool


def run_train_objects(
    folder: Path,
    out: Path,
    *,
    preset: str | None = None,
    model: Path | None = None,
    seed: int = 0,
    stages: Stages = silent,
) -> TrainedObjects:
    """Learn from a folder of depth images, one sub-folder a class, and write one file.

    Views in one folder below the class's show one object; those that lie in the class's own folder, each its own. The
    preset is ``object`` unless said otherwise; one for places makes a recogniser of kinds of places. Raises DataError,
    ModelError as its parts do.
    """
    from depthprint.objects.trained_recogniser import TrainedRecogniser

    files = labelled_files(folder)
    encoder = require_model(model, preset, "object")
    recogniser = TrainedRecogniser.fit(
        encoder,
        read_labelled(files, folder),
        [file.label for file in files],
        groups=[str(f.path if f.path.parent.name == f.label else f.path.parent) for f in files],
        sources=[str(file.path) for file in files],
        seed=seed,
        progress=stages("encode the views"),
    )
    path = recogniser.save(out)
    return TrainedObjects(
        path,
        encoder.settings.name,
        recogniser.labels,
        len(files),
        recogniser.calibration.novelty is not None,
    )


def run_recognise(queries: Sequence[Path], model: Path) -> Recognition:
    """Recognise what depth images show, all of one object or place, with a saved recogniser."""
    from depthprint.objects.trained_recogniser import TrainedRecogniser

    recogniser = TrainedRecogniser.load(model)
    return recogniser.recognise([read_view(query) for query in queries])
