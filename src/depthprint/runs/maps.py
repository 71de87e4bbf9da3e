"""Maps on disk: built from a recording, merged, and read through."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from depthprint.errors import SettingsError
from depthprint.runs.models import require_model
from depthprint.runs.source import DataSource
from depthprint.runs.stages import Stages, silent

__all__ = ["MapSummary", "run_map_build", "run_map_info", "run_map_merge"]


@dataclass(frozen=True)
class MapSummary:
    """A map: its file, places, those with a pose, names of its runs, preset and fingerprint of its model."""

    path: Path
    n_places: int
    n_posed: int
    runs: tuple[str, ...]
    preset: str
    fingerprint: str
    voxel_m: float | None


def run_map_build(
    source: DataSource,
    out: Path,
    *,
    preset: str | None = None,
    model: Path | None = None,
    voxel_m: float | None = None,
    stages: Stages = silent,
) -> MapSummary:
    """Describe every frame and write all to the new map ``out``, with poses where they are known.

    ``voxel_m`` keeps points too, one a voxel of that side. The file appears when the last frame was described.
    """
    from depthprint.cascade.assembly import make_cascade
    from depthprint.cascade.settings import CascadeSettings
    from depthprint.io.atomic import atomic_path
    from depthprint.loop_closure import LoopClosureDetector
    from depthprint.place_database import PlaceDatabase

    _require_new(out)
    sequence = source.open(stages("make the world"))
    encoder = require_model(model, preset, sequence.preset)
    progress = stages("build the map")
    with (
        atomic_path(out) as temporary,
        PlaceDatabase.create(temporary, encoder, voxel_m=voxel_m) as database,
        database.transaction(),
    ):
        # The cascade keeps what the geometric check needs, wherever that will be made; here nothing is checked.
        recognizer = make_cascade(encoder, CascadeSettings(track=False))
        detector = LoopClosureDetector(recognizer, threshold=0.0, database=database)
        database.begin_run(sequence.name, simulated=sequence.simulated, world_up=sequence.world_up)
        for index in range(len(sequence)):
            detector.add(sequence[index], pose=None if sequence.poses is None else sequence.poses[index])
            progress(index + 1, len(sequence))
    return run_map_info(out)


def run_map_merge(first: Path, second: Path, out: Path, *, stages: Stages = silent) -> MapSummary:
    """Write the places of two maps of one model to the new map ``out``."""
    from depthprint.place_merge import merge_maps

    merge_maps(first, second, out, progress=stages("merge"))
    return run_map_info(out)


def run_map_info(path: Path) -> MapSummary:
    """Read a map through, checking all of it, and say what it holds."""
    from depthprint.place_database import PlaceDatabase

    with PlaceDatabase.open(path, read_only=True) as database:
        database.load_encoder()
        posed = sum(stored.place.T_world_sensor is not None for stored in database)
        runs = tuple(run.name for run in database.runs)
        return MapSummary(
            path, len(database), posed, runs, database.preset, database.fingerprint, database.voxel_m
        )


def _require_new(path: Path) -> None:
    if path.exists():
        raise SettingsError(
            f"{path}: expected the name of a new map, this file exists; 'depthprint map merge' joins two"
        )
