"""What a run on a sequence found: the loops, and distances sampled from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.evaluation.loop_record import LoopRecord

__all__ = ["FoundLoops", "SampledDistances"]


@dataclass(frozen=True)
class SampledDistances:
    """Distances (n, n) float64 between some frames, whose numbers are ``frames`` (n,) int64."""

    frames: npt.NDArray[np.int64]
    distances: npt.NDArray[np.float64]


@dataclass(frozen=True)
class FoundLoops:
    """Loops of one drive: every query's best match, the threshold, and whether it was given or set from the drive."""

    records: tuple[LoopRecord, ...]
    threshold: float | None
    threshold_from: str

    def accepted(self, record: LoopRecord) -> bool:
        """Whether a query's match counts as a loop."""
        return self.threshold is not None and record.match >= 0 and record.distance <= self.threshold

    @property
    def loops(self) -> tuple[LoopRecord, ...]:
        """The matches that count, in time order."""
        return tuple(record for record in self.records if self.accepted(record))
