"""RangeImage: metric depth with its projection; NaN is 'no return'."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.projection import Projection

__all__ = ["RangeImage"]


@dataclass(frozen=True)
class RangeImage:
    """One frame of depth.

    ranges_m: (height, width) float32 metres, NaN = no return; z for a Pinhole, Euclidean range otherwise; read-only.
    projection: how pixels become points.
    stamp_s: time in seconds, or None.
    sensor_height_m: height of the sensor above level ground, if known. Not None also states that the sensor is
        mounted level, so that a bird's-eye view can be made.
    mask: (height, width) bool, true on the object (crops of objects), or None.
    source: where the frame came from (file, index), for error messages.
    """

    ranges_m: npt.NDArray[np.float32]
    projection: Projection
    stamp_s: float | None = None
    sensor_height_m: float | None = None
    mask: npt.NDArray[np.bool_] | None = None
    source: str = ""
