"""7-Scenes: hand-held Kinect sequences with a camera-to-world pose a frame."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.datasets.frames import thin, up_axis
from depthprint.errors import DataError, SettingsError
from depthprint.io.depth_image import read_depth_image
from depthprint.io.poses import read_pose_files
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage

__all__ = ["seven_scenes"]

FRAME_NAME = re.compile(r"frame-(\d+)\.depth\.png")
PUBLISHED_CAMERA = Pinhole(585.0, 585.0, 320.0, 240.0, 640, 480)
GAP_IN_FRAME_NUMBERS = 100


def seven_scenes(path: Path | str, sequence: str | None = None, every: int = 1) -> RangeSequence:
    """Read ``frame-XXXXXX.depth.png`` (16 bit, mm) with ``.pose.txt`` and ``camera-intrinsics.txt``.

    path: a sequence folder, or a scene folder of ``seq-01``, ``seq-02``, ...; then ``sequence`` names one
        ('01' and 'seq-01' alike) and may be left out where there is only one. every: take every n-th frame.
    Without intrinsics the published camera is taken: 640 x 480, focal length 585, centre (320, 240). Loops by
    view overlap; the gap of 100 frame numbers is 50 frames where every second one is kept.
    Raises DataError for a folder without frames, for frames that lack a pose while others have one, and for
    malformed poses or intrinsics; SettingsError for ``every`` < 1. Source: Shotton et al., CVPR 2013.
    """
    folder = _sequence_folder(Path(path), sequence)
    numbered = _numbered_frames(folder)
    numbers = thin([number for number, _ in numbered], every)
    files = thin([file for _, file in numbered], every)
    camera = _camera(folder, files[0])
    poses = _poses(files)
    step = int(np.median(np.diff(numbers))) if len(numbers) > 1 else 1

    def read(index: int) -> RangeImage:
        return RangeImage(read_depth_image(files[index], 0.001), camera, source=str(files[index]))

    named = folder.resolve()
    name = f"{named.parent.name}/{named.name}" if re.fullmatch(r"seq-\d+", named.name) else named.name
    return RangeSequence(
        name=f"seven_scenes/{name}",
        read=read,
        length=len(files),
        preset="handheld",
        poses=poses,
        world_up=(0.0, -1.0, 0.0) if poses is None else up_axis(poses, (0.0, -1.0, 0.0)),
        truth=LoopTruth(
            "overlap", gap=max(1, round(GAP_IN_FRAME_NUMBERS / step)), positive=0.5, negative=0.3
        ),
    )


def has_frames(folder: Path) -> bool:
    """Whether a folder holds frames of this data set."""
    return any(FRAME_NAME.fullmatch(p.name) for p in folder.glob("frame-*.depth.png"))


def sequence_folders(scene: Path) -> list[Path]:
    """Sequence folders of a scene that hold frames."""
    return sorted(p for p in scene.glob("seq-*") if p.is_dir() and has_frames(p))


def _sequence_folder(path: Path, sequence: str | None) -> Path:
    if not path.is_dir():
        raise DataError(f"{path}: expected a folder of 7-Scenes frames, got no such folder")
    wanted = None if sequence is None else f"seq-{int(sequence):02d}" if sequence.isdigit() else sequence
    if has_frames(path):
        if wanted not in (None, path.resolve().name):
            raise SettingsError(f"sequence: {path} is itself a sequence folder, got {sequence!r}")
        return path
    found = sequence_folders(path)
    if not found:
        raise DataError(
            f"{path}: expected frame-XXXXXX.depth.png files or seq-XX folders of them, got neither"
        )
    names = ", ".join(p.name for p in found)
    if wanted is None:
        if len(found) > 1:
            raise DataError(f"{path}: expected the name of a sequence, one of {names}")
        return found[0]
    for folder in found:
        if folder.name == wanted:
            return folder
    raise DataError(f"{path}: expected sequence {sequence!r} among {names}")


def _numbered_frames(folder: Path) -> list[tuple[int, Path]]:
    matches = ((FRAME_NAME.fullmatch(p.name), p) for p in folder.iterdir())
    return sorted((int(m.group(1)), p) for m, p in matches if m)


def _camera(folder: Path, first: Path) -> Pinhole:
    for file in (folder / "camera-intrinsics.txt", folder.parent / "camera-intrinsics.txt"):
        if file.is_file():
            fx, fy, cx, cy = _intrinsics(file)
            height, width = read_depth_image(first, 0.001).shape
            return Pinhole(fx, fy, cx, cy, width, height)
    return PUBLISHED_CAMERA


def _intrinsics(file: Path) -> tuple[float, float, float, float]:
    try:
        matrix = np.loadtxt(file, dtype=np.float64, ndmin=2)
    except ValueError as error:
        raise DataError(f"{file}: expected a 3 x 3 camera matrix, got {error}") from error
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or min(matrix[0, 0], matrix[1, 1]) <= 0:
        raise DataError(
            f"{file}: expected a finite 3 x 3 camera matrix with fx, fy > 0, got {matrix.tolist()}"
        )
    return float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])


def _poses(files: list[Path]) -> npt.NDArray[np.float64] | None:
    pose_files = [f.with_name(f.name.replace(".depth.png", ".pose.txt")) for f in files]
    missing = [f for f in pose_files if not f.is_file()]
    if len(missing) == len(files):
        return None
    if missing:
        raise DataError(f"{missing[0]}: missing; {len(files)} frames have {len(files) - len(missing)} poses")
    poses = read_pose_files(pose_files)
    poses.setflags(write=False)
    return poses
