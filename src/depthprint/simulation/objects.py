"""Simulated objects: categories are random shape grammars, instances vary their proportions."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import ObjectSet, ObjectView
from depthprint.errors import SettingsError
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.simulation.checks import require_whole
from depthprint.simulation.meshes import Triangles, box, merge
from depthprint.simulation.object_shapes import Proportions, grow

__all__ = ["simulated_objects"]

FloatArray = npt.NDArray[np.float64]

CAMERA = Pinhole(fx=575.8, fy=575.8, cx=319.5, cy=239.5, width=640, height=480)
ELEVATION_DEG = {1: 30.0, 2: 45.0, 4: 60.0}
DISTANCE_M = 1.0
MARGIN_PX = 10
# The projector's shadows come from what lies to the left of a crop: farther than its disparity at 0.6 m.
SHADOW_PX = 72
TABLE = box(-1.0, 1.0, -1.0, 1.0, -0.03, 0.0)
# Lower than this, a surface counts as the table.
TABLE_SLACK_M = 0.001
_SHAPE_STREAM, _NOISE_STREAM = 0, 1


def simulated_objects(
    n_categories: int = 20, n_instances: int = 4, frames: int = 3, seed: int = 0
) -> ObjectSet:
    """Masked depth crops of objects on a table, laid out as the UW RGB-D Object set; all simulated.

    A category is a random grammar of parts (a body; legs, wheels or a pedestal under it; a lid, a cone, a
    head or a back on top; a handle, arms or a spout beside it); its instances share the grammar and differ
    in proportions. Each is seen from about 1 m by a camera of 640 x 480 pixels and 575.8 px focal length,
    from 30, 45 and 60 degrees (videos 1, 2 and 4), in ``frames`` views of one turn (frames 1, 2, ...).
    A view's ranges are z in metres with a Kinect's noise, steps and holes; its mask marks the object. Views
    are rendered as they are read, the same bits in any order; their ``path`` is a name, not a file.
    Raises SettingsError for counts out of range, and when a view of another set is read.
    """
    require_whole("n_categories", n_categories, 1)
    require_whole("n_instances", n_instances, 1)
    require_whole("frames", frames, 1)
    require_whole("seed", seed, 0)
    keys: dict[ObjectView, tuple[int, int]] = {}
    digits = max(2, len(str(n_categories)))
    for category in range(n_categories):
        for instance in range(n_instances):
            for video in ELEVATION_DEG:
                for frame in range(1, frames + 1):
                    kind = f"shape{category + 1:0{digits}d}"
                    name = f"{kind}_{instance + 1}"
                    path = f"{kind}/{name}/{name}_{video}_{frame}"
                    keys[ObjectView(kind, name, video, frame, path)] = (category, instance)

    @lru_cache(maxsize=8)
    def stage(category: int, instance: int) -> _Stage:
        return _Stage(seed, category, instance)

    def read(view: ObjectView) -> RangeImage:
        if view not in keys:
            raise SettingsError(f"simulated_objects: expected one of its own views, got {view}")
        category, instance = keys[view]
        turn_rad = 2 * math.pi * (view.frame - 1) / frames
        rng = np.random.default_rng([seed, _NOISE_STREAM, category, instance, view.video, view.frame])
        source = f"simulated_objects seed {seed}, {view.path}"
        return stage(category, instance).view(ELEVATION_DEG[view.video], turn_rad, rng, source)

    return ObjectSet(
        name=f"simulated_objects/seed{seed}",
        views=tuple(keys),
        read=read,
        elevation_deg=dict(ELEVATION_DEG),
        simulated=True,
    )


class _Stage:
    """One object on the table, and the camera that goes about it."""

    def __init__(self, seed: int, category: int, instance: int) -> None:
        from depthprint.simulation.ray_casting import RayScene

        grammar = np.random.default_rng([seed, _SHAPE_STREAM, category])
        variation = np.random.default_rng([seed, _SHAPE_STREAM, category, instance + 1])
        self._object = grow(Proportions(grammar, variation))
        self._scene = RayScene(merge([self._object, TABLE]))
        self._start_rad = float(variation.normal(0, math.radians(8)))
        self._distance_m = DISTANCE_M * float(variation.uniform(0.95, 1.05))

    def view(
        self, elevation_deg: float, turn_rad: float, rng: np.random.Generator, source: str
    ) -> RangeImage:
        from depthprint.simulation.sensor_noise import kinect_noise

        T_world_sensor = _orbit(math.radians(elevation_deg), self._start_rad + turn_rad, self._distance_m)
        left, top, right, bottom = _window(self._object, T_world_sensor)
        crop = CAMERA.cropped(left, top, right - left, bottom - top)
        wide = replace(crop, cx=crop.cx + SHADOW_PX, width=crop.width + SHADOW_PX)
        true_m = self._scene.cast(wide, T_world_sensor)
        height_m = wide.points(true_m).astype(np.float64) @ T_world_sensor[2, :3] + T_world_sensor[2, 3]
        ranges_m = kinect_noise(true_m, wide, rng)[:, SHADOW_PX:]
        return RangeImage(ranges_m, crop, mask=height_m[:, SHADOW_PX:] > TABLE_SLACK_M, source=source)


def _orbit(elevation_rad: float, azimuth_rad: float, distance_m: float) -> FloatArray:
    """Pose T_world_sensor of a camera that looks at a point 5 cm above the middle of the table."""
    c, s = math.cos(azimuth_rad), math.sin(azimuth_rad)
    out, up = math.cos(elevation_rad), math.sin(elevation_rad)
    forward = np.array([-c * out, -s * out, -up])
    right = np.array([-s, c, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = np.array([0.0, 0.0, 0.05]) - distance_m * forward
    return pose


def _window(triangles: Triangles, T_world_sensor: FloatArray) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the object in the whole image, with the margin."""
    corners = (triangles.reshape(-1, 3) - T_world_sensor[:3, 3]) @ T_world_sensor[:3, :3]
    u, v, _ = CAMERA.project(corners)
    left, top = max(0, math.floor(u.min()) - MARGIN_PX), max(0, math.floor(v.min()) - MARGIN_PX)
    right, bottom = math.ceil(u.max()) + 1 + MARGIN_PX, math.ceil(v.max()) + 1 + MARGIN_PX
    return left, top, min(CAMERA.width, right), min(CAMERA.height, bottom)
