"""Any folder of depth images or point clouds, in name order, with poses and a camera where given."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.datasets.camera_file import CameraDescription, read_camera_file
from depthprint.datasets.frames import natural_order, thin, up_axis
from depthprint.errors import DataError, SettingsError
from depthprint.io.depth_image import read_depth_image
from depthprint.io.point_cloud import read_point_cloud
from depthprint.io.poses import read_poses, read_tum_poses
from depthprint.projection import Pinhole, Projection, Spherical
from depthprint.range_image import RangeImage

__all__ = ["generic"]

IMAGE_SUFFIXES = (".png", ".pgm", ".npy", ".npz")
CLOUD_SUFFIXES = (".bin", ".pcd", ".ply")
# Focal length over width of a Kinect: a field of view of 57.4 degrees.
KINECT_FOCAL_BY_WIDTH = 585.0 / 640.0
TUM_COLUMNS = 8
GAP_STREET, GAP_HANDHELD = 100, 50

logger = logging.getLogger("depthprint")


def generic(
    folder: Path | str,
    *,
    poses: Path | str | None = None,
    pattern: str | None = None,
    every: int = 1,
    **camera: float | str | None,
) -> RangeSequence:
    """Read the depth images or point clouds of a folder, in natural name order.

    Images: PNG, PGM, NPY, NPZ. Clouds: BIN, PCD, PLY.
    poses: file of one T_world_sensor a frame (KITTI or TUM rows); by default ``poses.txt`` in the folder, and
        no poses where there is none. pattern: glob of the frames, needed where kinds are mixed.
    every: take every n-th frame, and its pose.
    camera: fields of ``camera.json`` (fx, fy, cx, cy, width, height, depth_scale_m, sensor_height_m,
        projection, and for 'spherical' azimuth_min_rad, azimuth_max_rad, elevation_min_rad,
        elevation_max_rad); they go before those of the file. depth_scale_m is metres a unit of integer
        images, 0.001 by default.
    Depth images are pinhole unless the camera says 'spherical'. Without any of fx, fy, cx, cy a Kinect-like
    camera of 57.4 degrees across is assumed, and a warning logged. Point clouds are in the frame of the
    projection: x forward, y left, z up for spherical, the default (64 x 2048, -24.9 to 2 degrees).
    Preset 'lidar' for spherical, 'street' for a pinhole of known height, else 'handheld'. 'Up' of the world
    is the axis nearest to the sensors' mean 'up'.
    Raises DataError for an empty folder, mixed kinds, a pose count other than the frame count, a camera that
    lacks fields, frames of two sizes (when read); SettingsError for unknown options.
    """
    folder = Path(folder)
    files = _frame_files(folder, pattern)
    description = _description(folder, camera)
    projection = _projection(files[0], description)
    T_world_sensor, stamps_s = _poses(folder, poses, len(files))
    kept = np.array(thin(range(len(files)), every))
    if T_world_sensor is not None:
        T_world_sensor = T_world_sensor[kept]
        T_world_sensor.setflags(write=False)
    load = _loader(files[0], projection, description)

    def read(index: int) -> RangeImage:
        frame = int(kept[index])
        return load(files[frame], None if stamps_s is None else float(stamps_s[frame]))

    sensor_up = (0.0, -1.0, 0.0) if isinstance(projection, Pinhole) else (0.0, 0.0, 1.0)
    preset = _preset(projection, description)
    return RangeSequence(
        name=f"generic/{folder.resolve().name}",
        read=read,
        length=len(kept),
        preset=preset,
        poses=T_world_sensor,
        world_up=(0.0, 0.0, 1.0) if T_world_sensor is None else up_axis(T_world_sensor, sensor_up),
        truth=_truth(preset, every),
        simulated=description.simulated,
    )


def has_frames(folder: Path) -> bool:
    """Whether a folder holds files of a kind that can be read."""
    return any(p.suffix.lower() in IMAGE_SUFFIXES + CLOUD_SUFFIXES for p in folder.iterdir())


def _frame_files(folder: Path, pattern: str | None) -> list[Path]:
    known = IMAGE_SUFFIXES + CLOUD_SUFFIXES
    if not folder.is_dir():
        raise DataError(f"{folder}: expected a folder of frames, got no such folder")
    files = [p for p in folder.glob(pattern or "*") if p.is_file() and p.suffix.lower() in known]
    if not files:
        raise DataError(f"{folder}: expected {pattern or ', '.join('*' + s for s in known)} files, got none")
    suffixes = sorted({p.suffix.lower() for p in files})
    if len(suffixes) > 1:
        raise DataError(
            f"{folder}: expected frames of one kind, got {', '.join('*' + s for s in suffixes)}; "
            "choose with the option pattern"
        )
    return natural_order(files)


def _description(folder: Path, options: dict[str, Any]) -> CameraDescription:
    stated = CameraDescription.from_fields(options, "camera options", SettingsError)
    file = folder / "camera.json"
    return read_camera_file(file).overridden_by(stated) if file.is_file() else stated


def _projection(first: Path, camera: CameraDescription) -> Projection:
    if first.suffix.lower() in CLOUD_SUFFIXES:
        if camera.projection != "pinhole":
            return camera.spherical(Spherical.hdl64())
        if camera.width is None or camera.height is None:
            raise DataError(f"{camera.source}: point clouds seen by a pinhole camera need width and height")
        return camera.pinhole((camera.height, camera.width), first)
    shape = _image_shape(first, camera)
    if camera.projection == "spherical":
        return camera.spherical(Spherical.hdl64(), shape, first)
    if camera.has_intrinsics:
        return camera.pinhole(shape, first)
    camera.check_size(shape, first)
    focal = KINECT_FOCAL_BY_WIDTH * shape[1]
    logger.warning(
        "%s: no fx, fy, cx, cy in camera.json or options; assuming a Kinect-like camera, fx = fy = %.1f px",
        first.parent,
        focal,
    )
    return Pinhole(focal, focal, (shape[1] - 1) / 2, (shape[0] - 1) / 2, shape[1], shape[0])


def _image_shape(path: Path, camera: CameraDescription) -> tuple[int, int]:
    height, width = read_depth_image(path, _scale(camera)).shape
    return height, width


def _scale(camera: CameraDescription) -> float:
    return 0.001 if camera.depth_scale_m is None else camera.depth_scale_m


def _loader(
    first: Path, projection: Projection, camera: CameraDescription
) -> Callable[[Path, float | None], RangeImage]:
    height_m = camera.sensor_height_m

    def load_image(path: Path, stamp_s: float | None) -> RangeImage:
        ranges_m = read_depth_image(path, _scale(camera))
        if ranges_m.shape != (projection.height, projection.width):
            raise DataError(
                f"{path}: expected {projection.width} x {projection.height} pixels as in {first.name}, "
                f"got {ranges_m.shape[1]} x {ranges_m.shape[0]}"
            )
        return RangeImage(ranges_m, projection, stamp_s=stamp_s, sensor_height_m=height_m, source=str(path))

    def load_cloud(path: Path, stamp_s: float | None) -> RangeImage:
        return RangeImage.from_points(
            read_point_cloud(path).points,
            projection,
            stamp_s=stamp_s,
            sensor_height_m=height_m,
            source=str(path),
        )

    return load_cloud if first.suffix.lower() in CLOUD_SUFFIXES else load_image


def _poses(
    folder: Path, poses: Path | str | None, count: int
) -> tuple[npt.NDArray[np.float64] | None, npt.NDArray[np.float64] | None]:
    path = folder / "poses.txt" if poses is None else Path(poses)
    if poses is None and not path.is_file():
        return None, None
    T_world_sensor, stamps_s = read_poses(path), None
    if _columns(path) == TUM_COLUMNS:
        stamps_s, T_world_sensor = read_tum_poses(path)
    if len(T_world_sensor) != count:
        raise DataError(
            f"{path}: expected one pose a frame, got {len(T_world_sensor)} poses "
            f"for {count} frames in {folder}"
        )
    return T_world_sensor, stamps_s


def _columns(path: Path) -> int:
    with path.open(encoding="utf-8", errors="replace") as file:
        rows = (line.split() for line in file)
        return next((len(words) for words in rows if words and not words[0].startswith("#")), 0)


def _preset(projection: Projection, camera: CameraDescription) -> str:
    if isinstance(projection, Spherical):
        return "lidar"
    return "handheld" if camera.sensor_height_m is None else "street"


def _truth(preset: str, every: int) -> LoopTruth:
    if preset == "handheld":
        return LoopTruth("overlap", max(1, round(GAP_HANDHELD / every)), positive=0.5, negative=0.3)
    heading_deg = None if preset == "lidar" else 45.0
    return LoopTruth("distance", max(1, round(GAP_STREET / every)), 4.0, 10.0, heading_deg)
