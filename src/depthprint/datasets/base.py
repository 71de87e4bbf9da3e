"""What a sequence of frames and a set of object views look like to everything above them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.range_image import RangeImage

__all__ = ["LoopTruth", "ObjectSet", "ObjectView", "RangeSequence", "name_and_kind"]


def name_and_kind(name: str, simulated: bool) -> str:
    """The name of some data, and that its depth is simulated where the name does not say so itself."""
    return f"{name} (simulated)" if simulated and "simulated" not in name else name


@dataclass(frozen=True)
class LoopTruth:
    """How ground truth of loops is made from poses (three values: positive, ignore, negative).

    kind 'distance': positive below ``positive`` metres (horizontal) and heading within ``heading_deg`` (None: any
    heading), negative above ``negative`` metres. kind 'overlap': positive above ``positive`` share of view overlap
    both ways, negative below ``negative`` (depth reprojected, within ``overlap_tolerance_m``).
    ``gap``: candidates j of query i satisfy i - j > gap.
    """

    kind: str = "distance"
    gap: int = 100
    positive: float = 4.0
    negative: float = 10.0
    heading_deg: float | None = 45.0
    overlap_tolerance_m: float = 0.10


@dataclass(frozen=True)
class RangeSequence:
    """Frames in time order, read lazily.

    name: for reports, e.g. 'seven_scenes/redkitchen_seq01'.
    read: frame index -> RangeImage (raises DataError naming the file).
    length: number of frames.
    preset: encoder preset that suits the sensor ('street', 'handheld', 'lidar', 'laser').
    poses: (length, 4, 4) float64 T_world_sensor in the projection's own sensor frame, or None.
    world_up: unit vector of 'up' in the world frame (KITTI camera world: (0, -1, 0)).
    truth: default ground truth for this kind of data.
    simulated: whether the depth is simulated; reports must say so.
    """

    name: str
    read: Callable[[int], RangeImage]
    length: int
    preset: str
    poses: npt.NDArray[np.float64] | None = None
    world_up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    truth: LoopTruth = field(default_factory=LoopTruth)
    simulated: bool = False

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> RangeImage:
        if not 0 <= index < self.length:
            raise IndexError(index)
        return self.read(index)

    def __post_init__(self) -> None:
        if self.poses is not None and self.poses.shape != (self.length, 4, 4):
            raise DataError(f"{self.name}: {self.length} frames but poses of shape {self.poses.shape}")


@dataclass(frozen=True)
class ObjectView:
    """One crop of an object: lazily read by ``ObjectSet.read``."""

    category: str
    instance: str
    video: int
    frame: int
    path: str


@dataclass(frozen=True)
class ObjectSet:
    """Views of objects, UW RGB-D layout; ``elevation_deg`` maps a video number to its elevation."""

    name: str
    views: Sequence[ObjectView]
    read: Callable[[ObjectView], RangeImage]
    elevation_deg: dict[int, float]
    simulated: bool = False
