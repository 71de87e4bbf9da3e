"""KITTI odometry as published: stereo pairs by semi-global matching, or Velodyne scans."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.datasets.frames import thin
from depthprint.datasets.kitti_calibration import KittiCalibration, read_kitti_calibration
from depthprint.errors import DataError, SettingsError
from depthprint.io.poses import read_poses
from depthprint.io.velodyne import read_velodyne_bin
from depthprint.projection import Pinhole, Spherical
from depthprint.range_image import RangeImage
from depthprint.stereo_matching import SemiGlobalMatching, sgbm_depth

__all__ = ["kitti_odometry"]

FloatArray = npt.NDArray[np.float64]

CAMERA_HEIGHT_M = 1.65
VELODYNE_HEIGHT_M = 1.73
WORLD_UP = (0.0, -1.0, 0.0)
GAP_IN_FRAMES = 100
STEREO_PAIRS = ((0, 1), (2, 3))
# Without a calib.txt only the turn from x forward, y left, z up to the camera's axes is known; the LiDAR
# stands 0.3 m from the camera, which is then taken as nothing.
T_CAM0_VELO_NOMINAL = np.array(
    [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True)
class _Frames:
    """Files of one sequence by frame number, the projection's frame in camera 0, and how one is read."""

    numbers: list[int]
    read: Callable[[int, float | None], RangeImage]
    T_cam0_sensor: FloatArray


def kitti_odometry(
    root: Path | str,
    sequence: str | None = None,
    source: str | None = None,
    every: int = 1,
    lidar_width: int = 2048,
    matching: SemiGlobalMatching | None = None,
) -> RangeSequence:
    """Read a sequence of ``sequences/SS/{image_0,image_1,image_2,image_3,velodyne,calib.txt,times.txt}``.

    root: the folder that holds ``sequences`` and ``poses``, its parent with ``dataset``, or a sequence
        folder.
    sequence: '00' and so on; left out, '00' where there are several. every: take every n-th frame.
    source: 'stereo' (grey pair, else colour pair; depth of the left camera) or 'velodyne' (64 beams,
        ``lidar_width`` columns); left out, stereo where there are pairs. matching: settings of the stereo
        matcher.
    Poses are picked by frame number from ``poses/SS.txt`` (or ``poses.txt`` in the sequence folder) and
    carried from camera 0 to the sensor by calib.txt; without one, the LiDAR is taken to stand at camera 0.
    Sequences without published poses have none here. World: camera 0 of the first frame, y down.
    Raises DataError for a layout other than the published one, unequal image pairs, too few poses or times, a
    missing or malformed calibration; SettingsError for options that it does not know.
    Source: Geiger et al., CVPR 2012.
    """
    folder = _sequence_folder(Path(root), sequence)
    chosen = _source(folder, source)
    if chosen == "stereo":
        frames = _stereo_frames(folder, matching or SemiGlobalMatching())
    else:
        frames = _velodyne_frames(folder, lidar_width)
    numbers = thin(frames.numbers, every)
    name = folder.resolve().name
    times = _times(folder, numbers)
    poses = _poses(folder, numbers, frames.T_cam0_sensor, times)
    stamps_s = None if times is None else times[numbers]
    step = max(1, int(np.median(np.diff(numbers)))) if len(numbers) > 1 else 1

    def read(index: int) -> RangeImage:
        return frames.read(numbers[index], None if stamps_s is None else float(stamps_s[index]))

    stereo = chosen == "stereo"
    return RangeSequence(
        name=f"kitti_odometry/{name} {chosen}",
        read=read,
        length=len(numbers),
        preset="street" if stereo else "lidar",
        poses=poses,
        world_up=WORLD_UP,
        truth=LoopTruth(
            "distance", max(1, round(GAP_IN_FRAMES / step)), 4.0, 10.0, heading_deg=45.0 if stereo else None
        ),
    )


def is_sequence_folder(folder: Path) -> bool:
    """Whether a folder is laid out as one sequence."""
    return (folder / "velodyne").is_dir() or any(_has_pair(folder, pair) for pair in STEREO_PAIRS)


def sequences_folder(root: Path) -> Path | None:
    """The folder ``sequences`` below a root, or None."""
    for candidate in (root / "sequences", root / "dataset" / "sequences", root):
        if candidate.name == "sequences" and candidate.is_dir():
            return candidate
    return None


def _has_pair(folder: Path, pair: tuple[int, int]) -> bool:
    return all((folder / f"image_{camera}").is_dir() for camera in pair)


def _sequence_folder(root: Path, sequence: str | None) -> Path:
    if not root.is_dir():
        raise DataError(f"{root}: expected a KITTI odometry folder, got no such folder")
    if is_sequence_folder(root):
        if sequence not in (None, root.resolve().name):
            raise SettingsError(f"sequence: {root} is itself a sequence folder, got {sequence!r}")
        return root
    parent = sequences_folder(root)
    if parent is None:
        raise DataError(
            f"{root}: expected a folder 'sequences' (or 'dataset/sequences'), or a sequence folder with "
            "image_0 and image_1, image_2 and image_3, or velodyne; got none of them"
        )
    found = {p.name: p for p in sorted(parent.iterdir()) if p.is_dir() and is_sequence_folder(p)}
    if sequence is None:
        sequence = next(iter(found)) if len(found) == 1 else "00"
    if sequence not in found:
        raise DataError(f"{parent}: expected sequence {sequence!r}, got {', '.join(found) or 'none'}")
    return found[sequence]


def _source(folder: Path, source: str | None) -> str:
    if source is None:
        return "stereo" if any(_has_pair(folder, pair) for pair in STEREO_PAIRS) else "velodyne"
    if source not in ("stereo", "velodyne"):
        raise SettingsError(f"source: expected 'stereo' or 'velodyne', got {source!r}")
    return source


def _numbered(folder: Path, suffix: str) -> dict[int, Path]:
    if not folder.is_dir():
        raise DataError(f"{folder}: expected a folder of XXXXXX{suffix} files, got no such folder")
    pattern = re.compile(r"(\d+)" + re.escape(suffix))
    matches = ((pattern.fullmatch(p.name), p) for p in folder.iterdir())
    files = dict(sorted((int(m.group(1)), p) for m, p in matches if m))
    if not files:
        raise DataError(f"{folder}: expected XXXXXX{suffix} files, got none")
    return files


def _calibration(folder: Path) -> KittiCalibration | None:
    path = folder / "calib.txt"
    return read_kitti_calibration(path) if path.is_file() else None


def _stereo_frames(folder: Path, matching: SemiGlobalMatching) -> _Frames:
    from depthprint.io.grey_image import read_grey_image

    pair = next((p for p in STEREO_PAIRS if _has_pair(folder, p)), STEREO_PAIRS[0])
    left, right = (_numbered(folder / f"image_{camera}", ".png") for camera in pair)
    if left.keys() != right.keys():
        odd = min(left.keys() ^ right.keys())
        raise DataError(
            f"{folder}: {len(left)} images in image_{pair[0]} but {len(right)} in image_{pair[1]}; "
            f"frame {odd:06d} is in one of them only"
        )
    calibration = _calibration(folder)
    if calibration is None:
        raise DataError(
            f"{folder / 'calib.txt'}: missing; stereo depth needs the focal length and the baseline"
        )
    rig = calibration.rig(*pair)
    first_number = next(iter(left))
    height, width = read_grey_image(left[first_number]).shape
    camera = Pinhole(rig.fx, rig.fy, rig.cx, rig.cy, width, height)

    def read(number: int, stamp_s: float | None) -> RangeImage:
        images = [read_grey_image(side[number]) for side in (left, right)]
        source = str(left[number])
        depth_m = sgbm_depth(
            *images, focal_px=rig.fx, baseline_m=rig.baseline_m, settings=matching, source=source
        )
        return RangeImage(depth_m, camera, stamp_s=stamp_s, sensor_height_m=CAMERA_HEIGHT_M, source=source)

    return _Frames(list(left), read, rig.T_cam0_left)


def _velodyne_frames(folder: Path, width: int) -> _Frames:
    files = _numbered(folder / "velodyne", ".bin")
    calibration = _calibration(folder)
    T_cam0_velo = None if calibration is None else calibration.T_cam0_velo
    projection = Spherical.hdl64(width)

    def read(number: int, stamp_s: float | None) -> RangeImage:
        return RangeImage.from_points(
            read_velodyne_bin(files[number])[:, :3],
            projection,
            stamp_s=stamp_s,
            sensor_height_m=VELODYNE_HEIGHT_M,
            source=str(files[number]),
        )

    return _Frames(list(files), read, T_CAM0_VELO_NOMINAL if T_cam0_velo is None else T_cam0_velo)


def _poses(
    folder: Path, numbers: list[int], T_cam0_sensor: FloatArray, times: FloatArray | None
) -> FloatArray | None:
    own = folder.resolve()
    candidates = (own.parent.parent / "poses" / f"{own.name}.txt", folder / "poses.txt")
    path = next((c for c in candidates if c.is_file()), None)
    if path is None:
        return None
    T_world_cam0 = read_poses(path)
    if times is not None and len(times) != len(T_world_cam0):
        raise DataError(
            f"{path}: {len(T_world_cam0)} poses, but {folder / 'times.txt'} has {len(times)} times: "
            "expected one of each a frame"
        )
    if len(T_world_cam0) <= numbers[-1]:
        raise DataError(
            f"{path}: {len(T_world_cam0)} poses, but {folder} has frames up to number {numbers[-1]:06d}: "
            f"expected at least {numbers[-1] + 1}"
        )
    poses = np.asarray(T_world_cam0[numbers] @ T_cam0_sensor)
    poses.setflags(write=False)
    return poses


def _times(folder: Path, numbers: list[int]) -> FloatArray | None:
    path = folder / "times.txt"
    if not path.is_file():
        return None
    try:
        stamps_s = np.loadtxt(path, dtype=np.float64, ndmin=1)
    except ValueError as error:
        raise DataError(f"{path}: expected one number a line, got {error}") from error
    if stamps_s.ndim != 1 or len(stamps_s) <= numbers[-1] or not np.isfinite(stamps_s).all():
        raise DataError(
            f"{path}: expected one finite time a line for frames up to {numbers[-1]:06d}, got {len(stamps_s)}"
        )
    return np.asarray(stamps_s)
