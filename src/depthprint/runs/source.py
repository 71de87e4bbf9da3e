"""What the user points at: a recording or a simulated drive, opened as one sequence."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from depthprint.datasets.base import RangeSequence
from depthprint.errors import DataError, SettingsError
from depthprint.runs.stages import ProgressCallback

__all__ = ["DataSource", "spread"]

_SIMULATED = "simulated_street"
_KITTI_SOURCES = {"stereo": "stereo", "lidar": "velodyne"}


@dataclass(frozen=True)
class DataSource:
    """A path, or the name of a simulated data set, with the options that belong to it.

    dataset: registry name, '-' and '_' alike; guessed from the path when None. sequence: of a data set with several.
    every: take every k-th frame. poses_file: path to drive along when simulated, else the poses of a plain folder.
    sensor: 'stereo', 'kinect' or 'lidar' when simulated; 'stereo' or 'lidar' of KITTI. seed, cars_redrawn,
    length_m (metres of the built-in route): of the simulated street.
    """

    path: Path | None = None
    dataset: str | None = None
    sequence: str | None = None
    every: int = 1
    seed: int = 0
    poses_file: Path | None = None
    cars_redrawn: float = 0.2
    sensor: str | None = None
    length_m: float | None = None

    @property
    def dataset_name(self) -> str | None:
        """The name as the registry spells it."""
        return None if self.dataset is None else self.dataset.replace("-", "_")

    def open(self, progress: ProgressCallback | None = None) -> RangeSequence:
        """Open the sequence; ``progress`` reports on a world that must be made first.

        Raises SettingsError when options contradict each other, DataError when there is nothing to read.
        """
        if self.dataset_name == _SIMULATED:
            return self._simulate(progress)
        if self.path is None:
            raise SettingsError("expected DATA, a file or folder of depth, or --dataset simulated-street")
        from depthprint.datasets.registry import guess_dataset, open_sequence

        dataset = self.dataset_name or guess_dataset(self.path)
        options: dict[str, Any] = {} if self.every == 1 else {"every": self.every}
        if self.poses_file is not None:
            if dataset != "generic":
                raise SettingsError(
                    f"--poses belongs to a plain folder or to --dataset simulated-street, not {dataset}"
                )
            options["poses"] = self.poses_file
        if self.sensor is not None:
            if dataset != "kitti_odometry" or self.sensor not in _KITTI_SOURCES:
                raise SettingsError(
                    f"--sensor: expected --dataset simulated-street, or stereo or lidar of KITTI, "
                    f"got {self.sensor!r} for {dataset}"
                )
            options["source"] = _KITTI_SOURCES[self.sensor]
        return open_sequence(self.path, dataset=dataset, sequence=self.sequence, **options)

    def _simulate(self, progress: ProgressCallback | None) -> RangeSequence:
        if self.path is not None or self.sequence is not None:
            raise SettingsError(
                "the simulated street takes neither DATA nor --sequence; --poses gives its path"
            )
        if self.poses_file is not None and not self.poses_file.is_file():
            raise DataError(f"{self.poses_file}: no such pose file")
        from depthprint.datasets.simulated_street import simulated_street

        return simulated_street(
            poses_file=self.poses_file,
            every=self.every,
            sensor=self.sensor or "stereo",
            seed=self.seed,
            cars_redrawn=self.cars_redrawn,
            length_m=self.length_m,
            progress=progress,
        )

    def settings(self) -> dict[str, Any]:
        """Plain values for settings.json."""
        values: dict[str, Any] = {
            "path": None if self.path is None else str(self.path),
            "dataset": self.dataset_name,
            "sequence": self.sequence,
            "every": self.every,
            "poses": None if self.poses_file is None else str(self.poses_file),
            "sensor": self.sensor,
        }
        if self.dataset_name == _SIMULATED:
            values |= {
                "seed": self.seed,
                "cars_redrawn": self.cars_redrawn,
                "length_m": self.length_m,
                "sensor": self.sensor or "stereo",
            }
        return values


def spread(n: int, most: int) -> list[int]:
    """At most ``most`` of 0..n-1, evenly spread, the first and the last among them."""
    if n <= most:
        return list(range(n))
    return [round(i * (n - 1) / (most - 1)) for i in range(most)]
