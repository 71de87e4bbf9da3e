"""Simulated rooms: furnished, and seen by a depth camera that is carried through them by hand, twice."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.simulation.checks import require_whole
from depthprint.simulation.furnished_room import furnished_room
from depthprint.simulation.hand_held_path import there_and_back
from depthprint.simulation.meshes import Triangles, merge, moved

__all__ = ["simulated_rooms"]

FloatArray = npt.NDArray[np.float64]

CAMERA = Pinhole(fx=143.95, fy=143.95, cx=79.5, cy=59.5, width=160, height=120)
ROOM_SPACING_M = 20.0
# Nothing that stands this far from the walls reaches the height at which the camera is carried.
CAMERA_TO_WALL_M = 1.15
_WORLD_STREAM, _PATH_STREAM, _NOISE_STREAM = 0, 1, 2


def simulated_rooms(n_frames: int = 300, seed: int = 0, n_rooms: int = 2) -> RangeSequence:
    """Furnished rooms seen by a hand-held depth camera (160 x 120 pixels, 58 degrees); all simulated.

    Each room is visited twice, the second time backwards and not quite along the same way, so that views
    come back. Within a visit the path is smooth in all six degrees of freedom, 1.05 to 1.65 m above the
    floor; between visits the camera is carried to the next room unseen. A visit has n_frames / (2 n_rooms)
    frames; visits of fewer than about 50 frames hurry.
    Ranges are z in metres with a Kinect's noise, steps and holes; frame i is the same whenever it is read.
    Poses are T_world_sensor of the camera (x right, y down, z forward) in a world whose z points up.
    Truth: view overlap, gap 50. Raises SettingsError for counts out of range.
    """
    require_whole("n_rooms", n_rooms, 1)
    require_whole("n_frames", n_frames, 2 * n_rooms)
    require_whole("seed", seed, 0)
    from depthprint.simulation.ray_casting import RayScene
    from depthprint.simulation.sensor_noise import kinect_noise

    triangles, poses = _world_and_path(n_frames, seed, n_rooms)
    scene = RayScene(triangles)
    name = f"simulated_rooms/seed{seed}"

    def read(index: int) -> RangeImage:
        rng = np.random.default_rng([seed, _NOISE_STREAM, index])
        ranges_m = kinect_noise(scene.cast(CAMERA, poses[index]), CAMERA, rng)
        return RangeImage(ranges_m, CAMERA, source=f"{name}, frame {index}")

    return RangeSequence(
        name=name,
        read=read,
        length=n_frames,
        preset="handheld",
        poses=poses,
        world_up=(0.0, 0.0, 1.0),
        truth=LoopTruth("overlap", gap=50, positive=0.5, negative=0.3),
        simulated=True,
    )


def _world_and_path(n_frames: int, seed: int, n_rooms: int) -> tuple[Triangles, FloatArray]:
    lap_m = [np.array_split(lap, n_rooms) for lap in np.array_split(np.arange(n_frames), 2)]
    poses = np.empty((n_frames, 4, 4))
    rooms = []
    for room in range(n_rooms):
        width_m, depth_m, furnished = furnished_room(np.random.default_rng([seed, _WORLD_STREAM, room]))
        rooms.append(moved(furnished, room * ROOM_SPACING_M, 0.0))
        frames = np.concatenate([lap[room] for lap in lap_m])
        rng = np.random.default_rng([seed, _PATH_STREAM, room])
        free_m = np.array([width_m, depth_m]) / 2 - CAMERA_TO_WALL_M
        poses[frames] = there_and_back(rng, len(frames), free_m)
        poses[frames, 0, 3] += room * ROOM_SPACING_M
    poses.setflags(write=False)
    return merge(rooms), poses
