"""Write a simulated drive as the files of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from depthprint.errors import SettingsError
from depthprint.runs.source import DataSource
from depthprint.runs.stages import Stages, silent

__all__ = ["SimulatedRecording", "run_simulate"]


@dataclass(frozen=True)
class SimulatedRecording:
    """Where the frames are, and of what."""

    path: Path
    data: str
    n_images: int


def run_simulate(source: DataSource, out: Path, *, stages: Stages = silent) -> SimulatedRecording:
    """Make a simulated world, drive through it, and write frames, poses and camera to a new folder.

    Raises SettingsError for a data set that is not simulated, and for a folder that is there already.
    """
    if source.dataset_name != "simulated_street":
        raise SettingsError(f"simulate: expected --dataset simulated-street, got {source.dataset!r}")
    if out.exists():
        raise SettingsError(f"{out}: there already; give a folder that is new")
    from depthprint.simulation.writer import write_sequence

    sequence = source.open(stages("make the world"))
    write_sequence(sequence, out, progress=stages("cast rays and write"))
    return SimulatedRecording(out, sequence.name, len(sequence))
