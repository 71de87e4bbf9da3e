"""Write a sequence as the files of a recording: frames, poses.txt and camera.json, as ``generic`` reads them."""

from __future__ import annotations

import json
import math
import secrets
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from depthprint.datasets.base import RangeSequence
from depthprint.datasets.camera_file import ANGLE_FIELDS, PINHOLE_FIELDS, SIZE_FIELDS
from depthprint.errors import DataError
from depthprint.io.depth_image import write_depth_npy, write_depth_png
from depthprint.io.poses import write_kitti_poses
from depthprint.projection import Pinhole, Spherical
from depthprint.range_image import RangeImage

__all__ = ["write_sequence"]

# Metres a step of a 16-bit image, the finest first: for ranges up to 65.5, 131, 327 and 655 m.
DEPTH_SCALES_M = (0.001, 0.002, 0.005, 0.01)
LARGEST_STEP = 65534


def write_sequence(
    sequence: RangeSequence, folder: Path | str, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Write all frames with poses and camera to a new folder, whole or not at all; return its path.

    Pinhole frames become 16-bit PNG, in steps of 1 mm or, where a range needs it, 2, 5 or 10 mm: read back,
    ranges are within half a step, and camera.json states the step. Spherical frames become float32 NPY,
    without loss. Poses become KITTI rows, without loss. Stamps are not written.
    progress: called with (frames done, frames); starts again when a range needs a coarser step.
    Raises DataError for a folder that holds something already, an empty sequence, frames that differ in
    projection or sensor height, masks, a planar scanner's rows, and ranges over 655 m in a pinhole image.
    """
    target = Path(folder).absolute()
    _check_free(target)
    if len(sequence) == 0:
        raise DataError(f"{sequence.name}: expected at least one frame to write, got none")
    temporary = target.with_name(f".{target.name}-{secrets.token_hex(4)}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary.mkdir()
    except OSError as error:
        raise DataError(f"{target}: expected a folder that can be written to, got {error}") from error
    try:
        _write_all(sequence, temporary, progress)
        _check_free(target)
        if target.is_dir():
            target.rmdir()
        temporary.rename(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return target


def _check_free(target: Path) -> None:
    if target.is_dir():
        if any(target.iterdir()):
            raise DataError(f"{target}: expected a new or an empty folder to write to, it holds files")
    elif target.exists() or target.is_symlink():
        raise DataError(f"{target}: expected a folder to write to, got a file")


def _write_all(sequence: RangeSequence, folder: Path, progress: Callable[[int, int], None] | None) -> None:
    first = sequence[0]
    scale_m = DEPTH_SCALES_M[0]
    while (needed_m := _write_frames(sequence, first, folder, scale_m, progress)) != scale_m:
        scale_m = needed_m
    if sequence.poses is not None:
        write_kitti_poses(folder / "poses.txt", sequence.poses)
    fields = _camera_fields(first, scale_m)
    if sequence.simulated:
        fields["simulated"] = True
    (folder / "camera.json").write_text(json.dumps(fields, indent=2) + "\n", encoding="utf-8")


def _write_frames(
    sequence: RangeSequence,
    first: RangeImage,
    folder: Path,
    scale_m: float,
    progress: Callable[[int, int], None] | None,
) -> float:
    """Write frames until one needs a coarser step; return the step it needs, ``scale_m`` when all fit."""
    n = len(sequence)
    digits = max(6, len(str(n - 1)))
    for index in range(n):
        image = first if index == 0 else sequence[index]
        _check_like(image, first, f"{sequence.name}, frame {index}")
        if isinstance(image.projection, Pinhole):
            needed_m = max(scale_m, _depth_scale_m(image))
            if needed_m != scale_m:
                return needed_m
            write_depth_png(folder / f"{index:0{digits}d}.png", image.ranges_m, scale_m)
        else:
            write_depth_npy(folder / f"{index:0{digits}d}.npy", image.ranges_m)
        if progress is not None:
            progress(index + 1, n)
    return scale_m


def _depth_scale_m(image: RangeImage) -> float:
    """Finest step that holds the largest range, else the coarsest, which then cannot be written."""
    largest_m = float(np.max(image.ranges_m, initial=0.0, where=image.valid))
    fitting = (s for s in DEPTH_SCALES_M if math.floor(largest_m / s + 0.5) <= LARGEST_STEP)
    return next(fitting, DEPTH_SCALES_M[-1])


def _check_like(image: RangeImage, first: RangeImage, where: str) -> None:
    if not isinstance(image.projection, (Pinhole, Spherical)):
        raise DataError(
            f"{where}: expected pinhole or spherical frames to write, got {type(image.projection).__name__}"
        )
    if image.projection != first.projection:
        raise DataError(f"{where}: expected {first.projection} as in frame 0, got {image.projection}")
    if image.sensor_height_m != first.sensor_height_m:
        raise DataError(
            f"{where}: expected a sensor height of {first.sensor_height_m} m as in frame 0, "
            f"got {image.sensor_height_m}"
        )
    if image.mask is not None:
        raise DataError(f"{where}: expected a frame without a mask; a recording cannot hold masks")


def _camera_fields(first: RangeImage, scale_m: float) -> dict[str, Any]:
    pinhole = isinstance(first.projection, Pinhole)
    names = (*(PINHOLE_FIELDS if pinhole else ANGLE_FIELDS), *SIZE_FIELDS)
    fields: dict[str, Any] = {"projection": "pinhole" if pinhole else "spherical"}
    for name in names:
        value = getattr(first.projection, name)
        fields[name] = int(value) if name in SIZE_FIELDS else float(value)
    if pinhole:
        fields["depth_scale_m"] = scale_m
    if first.sensor_height_m is not None:
        fields["sensor_height_m"] = float(first.sensor_height_m)
    return fields
