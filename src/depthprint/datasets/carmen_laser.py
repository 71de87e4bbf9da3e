"""CARMEN logs of planar laser scanners with corrected poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.datasets.frames import thin
from depthprint.io.carmen import read_carmen_log

__all__ = ["carmen_laser"]

OUTDOOR_M = (4.0, 10.0)
INDOOR_M = (2.0, 5.0)
GAP_IN_SCANS = 100


def carmen_laser(path: Path | str, every: int = 1, indoor: bool | None = None) -> RangeSequence:
    """Read a CARMEN log, gzipped or not, as images of one row with planar poses.

    every: take every n-th scan. indoor: whether loops are counted at 2 m (5 m and beyond: other places)
        rather than at 4 m (10 m); None: indoors where the file's name holds 'corridor', 'indoor' or 'office',
        else outdoors.
    Poses are T_world_sensor with world z up; heading within 45 degrees.
    Raises DataError for a log without scans or malformed; SettingsError for ``every`` < 1.
    """
    path = Path(path)
    log = read_carmen_log(path)
    picked = np.array(thin(range(len(log)), every))
    if indoor is None:
        indoor = any(word in path.name.lower() for word in ("corridor", "indoor", "office"))
    positive, negative = INDOOR_M if indoor else OUTDOOR_M

    poses = None if log.poses_2d is None else log.poses()[picked]
    if poses is not None:
        poses.setflags(write=False)
    return RangeSequence(
        name=f"carmen_laser/{path.name.removesuffix('.gz').removesuffix('.log')}",
        read=lambda index: log.image(int(picked[index])),
        length=len(picked),
        preset="laser",
        poses=poses,
        truth=LoopTruth(
            "distance", max(1, round(GAP_IN_SCANS / every)), positive, negative, heading_deg=45.0
        ),
    )
