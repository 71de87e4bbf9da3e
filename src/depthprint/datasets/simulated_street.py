"""Simulated streets, driven along a real path or a built-in route. Simulated data, always called so."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.errors import SettingsError

__all__ = ["simulated_street"]

_GAP_FRAMES = 100
_LENGTH_M = 1500.0
_FULL_CIRCLE = ("lidar", "lidar-16", "lidar-32")
_PRESETS = {**dict.fromkeys(_FULL_CIRCLE, "lidar"), "laser": "laser"}


def simulated_street(
    *,
    poses_file: Path | str | None = None,
    every: int = 1,
    sensor: str = "stereo",
    seed: int = 0,
    cars_redrawn: float = 0.2,
    length_m: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> RangeSequence:
    """Drive a simulated town; frames are ray cast as they are read, the same bits in any order.

    poses_file: KITTI pose file whose horizontal path is driven; else a built-in route of ``length_m`` metres
        (1500 by default) with loops in both directions.
    every: take every k-th frame.
    sensor: 'stereo', 'kinect', 'lidar' (a spinning one of 64 beams), 'lidar-16', 'lidar-32', 'lidar-ahead' (120
        degrees ahead), or 'laser' (one planar row over 180 degrees).
    seed: of the town, its traffic and the noise; different seeds are different towns.
    cars_redrawn: share of the parking slots whose car is drawn anew at each later visit.
    Poses are T_world_sensor in the projection's own frame, in a world whose z points up.
    Raises SettingsError for a wrong option, DataError for a wrong pose file.
    """
    from depthprint.simulation.drive import SENSORS, Drive
    from depthprint.simulation.route import built_in_route, route_from_kitti_poses
    from depthprint.simulation.world import build_street_world

    if sensor not in SENSORS:
        raise SettingsError(f"sensor: expected one of {', '.join(SENSORS)}, got {sensor!r}")
    if isinstance(every, bool) or not isinstance(every, int) or every < 1:
        raise SettingsError(f"every: expected an integer of at least 1, got {every!r}")
    if poses_file is not None and length_m is not None:
        raise SettingsError("length_m: belongs to the built-in route; a pose file has its own length")
    if not 0 <= cars_redrawn <= 1:
        raise SettingsError(f"cars_redrawn: expected a share in 0..1, got {cars_redrawn}")
    if poses_file is None:
        route = built_in_route(_LENGTH_M if length_m is None else length_m, seed)
    else:
        route = route_from_kitti_poses(poses_file)
    if progress is not None:
        progress(0, 2)
    world = build_street_world(route, seed)
    if progress is not None:
        progress(1, 2)
    drive = Drive(world, SENSORS[sensor], cars_redrawn)
    poses = drive.poses()[::every]
    if progress is not None:
        progress(2, 2)
    where = "built-in" if poses_file is None else Path(poses_file).stem
    return RangeSequence(
        name=f"simulated_street/{where} ({sensor}, seed {seed}, {cars_redrawn:.0%} redrawn)",
        read=lambda index: drive.measure(index * every),
        length=len(poses),
        preset=_PRESETS.get(sensor, "street"),
        poses=poses,
        truth=LoopTruth(
            gap=max(1, _GAP_FRAMES // every), heading_deg=None if sensor in _FULL_CIRCLE else 45.0
        ),
        simulated=True,
    )
