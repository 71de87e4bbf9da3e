"""What the user points at: a recording or a simulated drive, opened as one sequence."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from depthprint.datasets.base import RangeSequence
from depthprint.errors import DataError, SettingsError
from depthprint.runs.stages import ProgressCallback

__all__ = ["DataSource", "every_kth", "spread"]

_SIMULATED = "simulated_street"


@dataclass(frozen=True)
class DataSource:
    """A path, or the name of a simulated data set, with the options that belong to it.

    dataset: registry name, '-' and '_' alike; guessed from the path when None. sequence: of a data set with several.
    every: take every k-th frame. seed, poses_file, cars_redrawn, sensor: of the simulated street.
    """

    path: Path | None = None
    dataset: str | None = None
    sequence: str | None = None
    every: int = 1
    seed: int = 0
    poses_file: Path | None = None
    cars_redrawn: float = 0.2
    sensor: str | None = None

    @property
    def dataset_name(self) -> str | None:
        """The name as the registry spells it."""
        return None if self.dataset is None else self.dataset.replace("-", "_")

    def open(self, progress: ProgressCallback | None = None) -> RangeSequence:
        """Open the sequence; ``progress`` reports on a world that must be made first.

        Raises SettingsError when options contradict each other, DataError when there is nothing to read.
        """
        if self.every < 1:
            raise SettingsError(f"every: expected a number >= 1, got {self.every}")
        if self.dataset_name == _SIMULATED:
            return self._simulate(progress)
        if self.sensor is not None or self.poses_file is not None:
            raise SettingsError("--sensor and --poses belong to --dataset simulated-street")
        if self.path is None:
            raise SettingsError("expected DATA, a file or folder of depth, or --dataset simulated-street")
        if not self.path.exists():
            raise DataError(f"{self.path}: no such file or folder")
        from depthprint.datasets.registry import open_sequence

        return every_kth(
            open_sequence(self.path, dataset=self.dataset_name, sequence=self.sequence), self.every
        )

    def _simulate(self, progress: ProgressCallback | None) -> RangeSequence:
        if self.path is not None or self.sequence is not None:
            raise SettingsError(
                "the simulated street takes neither DATA nor --sequence; --poses gives its path"
            )
        from depthprint.datasets.simulated_street import simulated_street

        return simulated_street(
            poses_file=self.poses_file,
            every=self.every,
            sensor=self.sensor or "stereo",
            seed=self.seed,
            cars_redrawn=self.cars_redrawn,
            progress=progress,
        )

    def settings(self) -> dict[str, Any]:
        """Plain values for settings.json."""
        simulated = self.dataset_name == _SIMULATED
        values: dict[str, Any] = {
            "path": None if self.path is None else str(self.path),
            "dataset": self.dataset_name,
            "sequence": self.sequence,
            "every": self.every,
        }
        if simulated:
            values["poses"] = None if self.poses_file is None else str(self.poses_file)
            values |= {
                "seed": self.seed,
                "cars_redrawn": self.cars_redrawn,
                "sensor": self.sensor or "stereo",
            }
        return values


def every_kth(sequence: RangeSequence, k: int) -> RangeSequence:
    """Keep frames 0, k, 2k, ...; the gap of the ground truth shrinks along, rounded up."""
    if k == 1:
        return sequence
    kept = range(0, len(sequence), k)
    read = sequence.read
    return replace(
        sequence,
        name=f"{sequence.name}, every {k}",
        read=lambda index: read(kept[index]),
        length=len(kept),
        poses=None if sequence.poses is None else sequence.poses[kept.start :: k],
        truth=replace(sequence.truth, gap=-(-sequence.truth.gap // k)),
    )


def spread(n: int, most: int) -> list[int]:
    """At most ``most`` of 0..n-1, evenly spread, the first and the last among them."""
    if n <= most:
        return list(range(n))
    return [round(i * (n - 1) / (most - 1)) for i in range(most)]
