"""What a geometric check must know of a sensor: its noise, its reach, how it moves, and what passes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from depthprint.errors import SettingsError
from depthprint.projection import LaserRow
from depthprint.range_image import RangeImage

__all__ = ["VerificationSettings", "settings_for"]


_LENGTHS = (
    "reach_m",
    "voxel_m",
    "max_pairing_m",
    "max_offset_m",
    "named_within_m",
    "witness_m",
    "agreeing_m",
)
_SHARES = (
    "coarse_overlap",
    "min_overlap",
    "min_overlap_seconded",
    "max_free_space_share",
    "max_free_space_share_seconded",
    "min_agreement",
    "min_agreement_seconded",
    "reached_elsewhere",
    "min_support",
    "offset_weight",
)


@dataclass(frozen=True)
class VerificationSettings:
    """How two views are aligned and when they count as one place.

    columns: views are thinned to at most this many columns.
    reach_m: returns further away are left out. voxel_m: spacing of the points that are aligned.
    tolerance: ranges agree within tolerance[0] + tolerance[1] r + tolerance[2] r^2 metres; noise: standard deviation of
        the difference of two of them, pose and all, in the same form; None where agreement is by tolerance alone.
    offset_weight: share of its agreement that a place loses, when one is to be named, at max_offset_m; at 1 the
        place that motion says is nearest is checked first.
    named_within_m: a match seen from further away is named after the place that odometry puts nearest to it, whether
        or not that view agrees enough.
    ground_clearance_m: where the sensor's height is known, points lower than this above the ground are not
        counted, since the ground of any two streets agrees.
    forward_m, sideways_m, yaw_rad, pitch_rad: offsets of the query from the match that the coarse search tries; for
        planar scans their extremes bound a search by correlation.
    coarse_overlap: a start under this overlap is not refined. refined_starts: best starts that are.
    whole_clouds: where the quick alignment by projection comes near but does not pass, align the whole clouds too.
    max_pairing_m: points further apart are no pair in the alignment. max_offset_m: a longer T_match_query is refused.
    min_points: fewer aligned points are refused. min_overlap: least share confirmed, both ways;
        min_overlap_seconded: where earlier frames were found at the same place.
    max_free_space_share: most that may lie in space seen free, of what is confirmed or so, both ways;
        max_free_space_share_seconded: where earlier frames were found at the same place.
    min_agreement, min_agreement_seconded: least ``Verification.agreement``. reached_elsewhere: agreement that wrong
        places of one shape often reach, under 1; what is over it is evidence. min_support: evidence of earlier frames
        over which a place counts as seconded by them.
    min_overlap_motion: least overlap of a view and the next one for odometry, which starts beside the truth, to
        believe their alignment; above 1 only what passes as a match is believed. motion_yaw_rad: turns from one view
        to the next about which the coarse search is made, one after the other until a match passes.
    witness_m: motion after which a view is a witness of its own. agreeing_m, agreeing_rad: how far a match may lie from
        where the matches before it and the motion since say, for each such motion.
    upright: whether the sensor turns about its own up alone, so that a heading can be carried along.
    way_m: how far back the frames are asked whose mean evidence a match's evidence is averaged with; 0: none.
    Raises SettingsError for values out of range.
    """

    columns: int = 160
    reach_m: float = 40.0
    voxel_m: float = 0.8
    tolerance: tuple[float, float, float] = (0.2, 0.0, 0.003)
    noise: tuple[float, float, float] | None = None
    ground_clearance_m: float = 0.4
    forward_m: tuple[float, ...] = (0.0,)
    sideways_m: tuple[float, ...] = (0.0,)
    yaw_rad: tuple[float, ...] = (0.0,)
    pitch_rad: tuple[float, ...] = (0.0,)
    coarse_overlap: float = 0.3
    refined_starts: int = 4
    whole_clouds: bool = False
    max_pairing_m: float = 1.5
    max_offset_m: float = 8.0
    offset_weight: float = 0.5
    named_within_m: float = math.inf
    min_points: int = 50
    min_overlap: float = 0.45
    min_overlap_seconded: float = 0.35
    max_free_space_share: float = 0.2
    max_free_space_share_seconded: float = 0.2
    min_agreement: float = 0.0
    min_agreement_seconded: float = 0.0
    reached_elsewhere: float = 0.0
    min_support: float = 0.0
    min_overlap_motion: float = 2.0
    motion_yaw_rad: tuple[float, ...] = (0.0,)
    witness_m: float = 3.5
    upright: bool = True
    way_m: float = 0.0
    agreeing_m: float = 0.6
    agreeing_rad: float = math.radians(3.0)

    def __post_init__(self) -> None:
        for name in ("columns", "refined_starts", "min_points"):
            if getattr(self, name) < 1:
                raise SettingsError(f"VerificationSettings: expected {name} >= 1, got {getattr(self, name)}")
        for name in (*_LENGTHS, "agreeing_rad"):
            if not getattr(self, name) > 0:
                raise SettingsError(f"VerificationSettings: expected {name} > 0, got {getattr(self, name)}")
        if not self.way_m >= 0:
            raise SettingsError(f"VerificationSettings: expected way_m >= 0, got {self.way_m}")
        for name in _SHARES:
            if not 0 <= getattr(self, name) <= 1:
                raise SettingsError(
                    f"VerificationSettings: expected {name} in [0, 1], got {getattr(self, name)}"
                )
        if self.reached_elsewhere == 1:
            raise SettingsError("VerificationSettings: expected reached_elsewhere < 1, got 1")
        for name in ("forward_m", "sideways_m", "yaw_rad", "pitch_rad", "motion_yaw_rad"):
            if not getattr(self, name):
                raise SettingsError(f"VerificationSettings: expected at least one offset in {name}, got none")


def _degrees(*angles: float) -> tuple[float, ...]:
    return tuple(math.radians(angle) for angle in angles)


_CAMERA = VerificationSettings(
    noise=(0.05, 0.0, 0.0013),
    offset_weight=1.0,
    named_within_m=3.0,
    min_overlap=0.25,
    min_overlap_seconded=0.15,
    max_free_space_share=0.6,
    max_free_space_share_seconded=0.6,
    min_agreement=0.55,
    min_agreement_seconded=0.25,
    reached_elsewhere=0.4,
    min_support=0.2,
    min_overlap_motion=0.2,
    forward_m=(0.0, -1.5, 1.5, -3.0, 3.0, -4.5, 4.5),
    sideways_m=(0.0, -1.5, 1.5),
    yaw_rad=_degrees(0, -5, 5, -10, 10),
)
_SPINNING = replace(
    _CAMERA,
    columns=360,
    voxel_m=1.0,
    tolerance=(0.3, 0.01, 0.0),
    noise=(0.1, 0.005, 0.0),
    offset_weight=0.5,
    min_overlap_seconded=0.25,
    min_agreement=0.3,
    min_agreement_seconded=0.2,
    reached_elsewhere=0.15,
    sideways_m=(0.0, -1.5, 1.5, -3.0, 3.0),
    yaw_rad=_degrees(0, -4, 4),
)
_HAND_HELD = VerificationSettings(
    reach_m=8.0,
    voxel_m=0.13,
    tolerance=(0.04, 0.0, 0.006),
    forward_m=(0.0, -0.25, 0.25),
    yaw_rad=_degrees(0, -8, 8, -16, 16, -24, 24),
    pitch_rad=_degrees(0, -8, 8, -16, 16),
    max_pairing_m=0.3,
    max_offset_m=2.5,
    max_free_space_share=0.1,
    max_free_space_share_seconded=0.1,
    witness_m=0.3,
    agreeing_m=0.15,
    agreeing_rad=math.radians(6.0),
    whole_clouds=True,
    upright=False,
)
_ROW = replace(
    _SPINNING,
    reach_m=50.0,
    named_within_m=math.inf,
    max_pairing_m=0.3,
    min_points=30,
    voxel_m=0.1,
    noise=(0.05, 0.01, 0.0),
    reached_elsewhere=0.2,
    min_overlap_motion=0.4,
    forward_m=(-4.0, 4.0),
    sideways_m=(-3.0, 3.0),
    yaw_rad=_degrees(-32, 32),
    refined_starts=4,
    motion_yaw_rad=_degrees(0, -42, 42),
    way_m=15.0,
)


def settings_for(image: RangeImage) -> VerificationSettings:
    """Settings that suit a frame's sensor: one row, spinning, a camera on a vehicle, or one held in the hand."""
    if isinstance(image.projection, LaserRow):
        return _ROW
    if image.projection.horizontal_fov_rad > math.pi:
        return _SPINNING
    return _HAND_HELD if image.sensor_height_m is None else _CAMERA
