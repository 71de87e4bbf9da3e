"""A drive through a town: what the sensor measures in each frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from depthprint.projection import LaserRow, Pinhole, Projection, Spherical
from depthprint.range_image import RangeImage
from depthprint.simulation.meshes import merge
from depthprint.simulation.parking import parked_cars, visit_switches
from depthprint.simulation.ray_casting import RayScene, nearest_surface
from depthprint.simulation.sensor_noise import kinect_noise, lidar_noise, stereo_noise
from depthprint.simulation.traffic import Traffic
from depthprint.simulation.world import StreetWorld

__all__ = ["SENSORS", "Drive", "SensorModel"]

# Beyond every sensor's reach, so that a car never appears at the edge of what is measured.
_SLOT_SIGHT_M = 105.0
_STRETCH_M = 25.0


@dataclass(frozen=True)
class SensorModel:
    """A sensor on the vehicle: its projection, its height, and what it makes of true ranges."""

    projection: Projection
    height_m: float
    measure: Callable[[npt.NDArray[np.float32], np.random.Generator], npt.NDArray[np.float32]]


# KITTI's image of 1241 x 376 at a quarter.
_STEREO = Pinhole(fx=718.856 / 4, fy=718.856 / 4, cx=607.1928 / 4, cy=185.2157 / 4, width=310, height=94)
_KINECT = Pinhole(fx=575.8 / 4, fy=575.8 / 4, cx=79.5, cy=59.5, width=160, height=120)
_LIDAR = Spherical(width=720, height=64)
_LIDAR_16 = Spherical.vlp16(720)
_LIDAR_32 = Spherical.hdl32(720)
# A solid-state scanner that looks ahead: 120 by 25 degrees.
_LIDAR_AHEAD = Spherical(
    width=240,
    height=64,
    azimuth_min_rad=math.radians(-60.0),
    azimuth_max_rad=math.radians(60.0),
    elevation_min_rad=math.radians(-15.0),
    elevation_max_rad=math.radians(10.0),
)
_LASER = LaserRow(360, -math.pi / 2, math.pi / 360)

SENSORS: dict[str, SensorModel] = {
    "stereo": SensorModel(_STEREO, 1.65, lambda ranges, rng: stereo_noise(ranges, _STEREO, rng)),
    "kinect": SensorModel(_KINECT, 1.2, lambda ranges, rng: kinect_noise(ranges, _KINECT, rng, far_m=10.0)),
    "lidar": SensorModel(_LIDAR, 1.73, lidar_noise),
    "lidar-16": SensorModel(_LIDAR_16, 1.73, lidar_noise),
    "lidar-32": SensorModel(_LIDAR_32, 1.73, lidar_noise),
    "lidar-ahead": SensorModel(_LIDAR_AHEAD, 1.73, lidar_noise),
    "laser": SensorModel(_LASER, 0.5, lambda ranges, rng: lidar_noise(ranges, rng, near_m=0.1, far_m=80.0)),
}


@dataclass
class Drive:
    """Frames of one drive; any frame may be measured at any time and always gives the same bits.

    cars_redrawn: share in 0..1 of the parking slots whose car is drawn anew at each later visit.
    """

    world: StreetWorld
    sensor: SensorModel
    cars_redrawn: float
    _parked: tuple[bytes, RayScene] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        route = self.world.route
        self._arc = route.arc_m
        self._static = RayScene(self.world.within(route.positions_m[::20], 400.0))
        self._switches = visit_switches(self.world.slots, route)
        self._traffic = Traffic(route, self.world.seed)
        self._parked = b"", RayScene(merge([]))

    def pose(self, frame: int) -> npt.NDArray[np.float64]:
        """T_world_sensor (4, 4): world z up, ground at 0; the sensor level, in its projection's own frame."""
        route = self.world.route
        heading = float(route.headings_rad[frame])
        c, s = np.cos(heading), np.sin(heading)
        R_world_flu = np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)])
        T_world_sensor = np.eye(4)
        T_world_sensor[:3, :3] = R_world_flu @ self.sensor.projection.R_flu_sensor
        T_world_sensor[:3, 3] = (*route.positions_m[frame], self.sensor.height_m)
        return T_world_sensor

    def poses(self) -> npt.NDArray[np.float64]:
        """All poses, (n, 4, 4)."""
        return np.stack([self.pose(frame) for frame in range(len(self.world.route))])

    def measure(self, frame: int) -> RangeImage:
        """What the sensor measures in a frame."""
        T_world_sensor = self.pose(frame)
        projection = self.sensor.projection
        scenes = (self._static, self._parked_near(frame), RayScene(self._traffic.at(frame)))
        true_m = nearest_surface(*(scene.cast(projection, T_world_sensor) for scene in scenes))
        rng = np.random.default_rng([self.world.seed, 71, frame])
        return RangeImage(
            self.sensor.measure(true_m, rng),
            projection,
            sensor_height_m=self.sensor.height_m,
            source=f"simulated street, seed {self.world.seed}, frame {frame}",
        )

    def _parked_near(self, frame: int) -> RayScene:
        """The parked cars in sight of the frame's stretch, made anew only where they are not the last ones."""
        slots, stretches = self.world.slots, (self._arc / _STRETCH_M).astype(np.int64)
        on_stretch = self.world.route.positions_m[stretches == stretches[frame]]
        offset = slots.positions_m[:, None] - on_stretch
        near = np.flatnonzero((np.hypot(offset[..., 0], offset[..., 1]) < _SLOT_SIGHT_M).any(axis=1))
        visits = np.array(
            [np.searchsorted(self._switches[slot], self._arc[frame]) for slot in near], dtype=np.int64
        )
        key = np.stack([near, visits]).tobytes()
        if self._parked[0] != key:
            cars = parked_cars(self.world.seed, slots, near, visits, self.cars_redrawn)
            self._parked = key, RayScene(cars)
        return self._parked[1]
