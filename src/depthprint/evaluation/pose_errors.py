"""How far the relative poses of right matches lie from the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.evaluation.loop_record import LoopRecord
from depthprint.rigid_motion import inverse_pose, rotation_angle

__all__ = ["PoseErrors", "match_pose_error", "pose_errors"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PoseErrors:
    """Medians over ``count`` accepted right matches; NaN without any."""

    count: int
    translation_m: float
    rotation_deg: float


def match_pose_error(
    T_match_query: FloatArray, T_world_match: FloatArray, T_world_query: FloatArray
) -> tuple[float, float]:
    """Metres and degrees between a relative pose (4, 4) and the one that two known poses give."""
    off = inverse_pose(T_world_query) @ T_world_match @ T_match_query
    return float(np.linalg.norm(off[:3, 3])), math.degrees(rotation_angle(off))


def pose_errors(records: Sequence[LoopRecord]) -> PoseErrors:
    """Medians over the right matches whose pose was measured and accepted."""
    known = [
        (r.translation_error_m, r.rotation_error_deg)
        for r in records
        if r.outcome == 1 and r.translation_error_m is not None and r.rotation_error_deg is not None
    ]
    if not known:
        return PoseErrors(0, math.nan, math.nan)
    metres, degrees = np.median(np.array(known, dtype=np.float64), axis=0)
    return PoseErrors(len(known), float(metres), float(degrees))
