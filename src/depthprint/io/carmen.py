"""CARMEN logs: planar laser scans with the pose of the laser."""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.io._files import read_bytes
from depthprint.projection import LaserRow
from depthprint.range_image import RangeImage

__all__ = ["CarmenLog", "read_carmen_log"]

FloatArray = npt.NDArray[np.float64]

_MESSAGES = ("FLASER", "ROBOTLASER1", "RAWLASER1")
_MAX_RANGE_PARAMETERS = ("robot_front_laser_max", "robot_frontlaser_max")
_TOP_SHARE = 0.995
_PILE_FACTOR = 10


@dataclass(frozen=True, eq=False)
class CarmenLog:
    """Scans of one log.

    ranges_m: (n, beams) float32, NaN = no return; beams from right to left; read-only.
    poses_2d: (n, 3) float64 x, y in metres and heading in radians of the laser, or None for raw scans.
    stamps_s: (n,) float64 as logged; corrected logs often hold zeros or stamps that do not increase.
    angle_min_rad, angle_step_rad: direction of the first beam (0 is forward) and the step to the next.
    max_range_m: ranges at or above it were taken for no return (infinity: none were).
    source: the file.
    """

    ranges_m: npt.NDArray[np.float32]
    poses_2d: FloatArray | None
    stamps_s: FloatArray
    angle_min_rad: float
    angle_step_rad: float
    max_range_m: float
    source: str = ""

    def __post_init__(self) -> None:
        for array in (self.ranges_m, self.poses_2d, self.stamps_s):
            if array is not None:
                array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.ranges_m)

    @property
    def projection(self) -> LaserRow:
        """How a scan's beams become points."""
        return LaserRow(self.ranges_m.shape[1], self.angle_min_rad, self.angle_step_rad)

    @property
    def stamps_increase(self) -> bool:
        """Whether the stamps can serve as times."""
        return bool((np.diff(self.stamps_s) > 0).all())

    def image(self, index: int) -> RangeImage:
        """Scan ``index`` as a range image of one row; no stamp where the log's stamps do not increase."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        return RangeImage(
            self.ranges_m[index][None],
            self.projection,
            stamp_s=float(self.stamps_s[index]) if self.stamps_increase else None,
            source=f"{self.source}, scan {index}",
        )

    def poses(self) -> FloatArray:
        """(n, 4, 4) T_world_laser, z = 0; DataError when the log holds no poses."""
        if self.poses_2d is None:
            raise DataError(f"{self.source}: expected scans with poses, got raw scans only")
        x, y, theta = self.poses_2d.T
        poses = np.tile(np.eye(4), (len(x), 1, 1))
        poses[:, 0, 0] = poses[:, 1, 1] = np.cos(theta)
        poses[:, 1, 0] = np.sin(theta)
        poses[:, 0, 1] = -np.sin(theta)
        poses[:, 0, 3], poses[:, 1, 3] = x, y
        return poses


@dataclass(frozen=True)
class _Scan:
    ranges: list[float]
    pose: list[float] | None
    stamp: float
    angles: tuple[float, float]
    max_range: float | None


def read_carmen_log(
    path: Path | str, *, message: str | None = None, max_range_m: float | None = None
) -> CarmenLog:
    """Read the laser scans of a CARMEN log, gzipped or not.

    message: 'FLASER', 'ROBOTLASER1' or 'RAWLASER1'; None takes the first of these that the log holds.
    max_range_m: ranges at or above it are no return. None takes the log's own statement (the front laser's
    parameter, or a ROBOTLASER1 or RAWLASER1 field), else looks for the pile of equal readings that lasers
    send for 'nothing seen': ten times as many ranges in the top half per cent as in the half per cent below
    it. ``math.inf`` keeps all. Ranges of zero or less, and not finite, are no return in any case.

    FLASER does not say its angles. It spans 180 degrees from -90: n beams are pi / n apart, or pi / (n - 1)
    when n is odd (181 or 361 beams: one also at the far end). The pose is the laser's, the first of the two.
    Raises DataError naming file and line for damaged lines, and for logs without scans.
    Format: the CARMEN toolkit's log format, as in the Radish collection.
    """
    path = Path(path)
    if message is not None and message not in _MESSAGES:
        raise SettingsError(f"message: expected one of {', '.join(_MESSAGES)}, got {message!r}")
    if max_range_m is not None and not max_range_m > 0:
        raise SettingsError(f"max_range_m: expected a positive number, got {max_range_m}")
    lines = _read_lines(path)
    chosen = message or _first_message(path, lines)
    scans: list[_Scan] = []
    stated: float | None = None
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words:
            continue
        if words[0] == "PARAM" and len(words) > 2 and words[1] in _MAX_RANGE_PARAMETERS:
            stated = _number(path, number, words[2])
            stated = stated if stated > 0 else None
        elif words[0] == chosen:
            scan = _parse_scan(path, number, words)
            if scans and (len(scan.ranges), scan.angles) != (len(scans[0].ranges), scans[0].angles):
                raise DataError(
                    f"{path}, line {number}: expected {len(scans[0].ranges)} beams at the angles as before, "
                    f"got {len(scan.ranges)} from {scan.angles[0]:g} rad by {scan.angles[1]:g}"
                )
            scans.append(scan)
    if not scans:
        raise DataError(f"{path}: expected {chosen} messages, got none")
    ranges = np.array([scan.ranges for scan in scans])
    limit = max_range_m or scans[0].max_range or stated or _find_max_range(ranges)
    ranges[~(np.isfinite(ranges) & (ranges > 0) & (ranges < limit))] = np.nan
    poses = [scan.pose for scan in scans if scan.pose is not None]
    return CarmenLog(
        ranges_m=ranges.astype(np.float32),
        poses_2d=np.array(poses) if poses else None,
        stamps_s=np.array([scan.stamp for scan in scans]),
        angle_min_rad=scans[0].angles[0],
        angle_step_rad=scans[0].angles[1],
        max_range_m=limit,
        source=str(path),
    )


def _read_lines(path: Path) -> list[str]:
    content = read_bytes(path)
    if content.startswith(b"\x1f\x8b"):
        try:
            content = gzip.decompress(content)
        except (OSError, EOFError, zlib.error) as error:
            raise DataError(f"{path}: expected a whole gzip file, got a damaged one ({error})") from error
    return content.decode("utf-8", errors="replace").splitlines()


def _first_message(path: Path, lines: Sequence[str]) -> str:
    present = {line.split(maxsplit=1)[0] for line in lines if line.strip()}
    for name in _MESSAGES:
        if name in present:
            return name
    raise DataError(f"{path}: expected a CARMEN log with {', '.join(_MESSAGES)} messages, got none of them")


def _parse_scan(path: Path, number: int, words: list[str]) -> _Scan:
    if words[0] == "FLASER":
        n = _count(path, number, words, 1)
        _require_words(path, number, words, 2 + n + 9)
        values = _numbers(path, number, words[2 : 2 + n + 6])
        _require_finite(path, number, values[n : n + 3])
        stamp = _number(path, number, words[2 + n + 6])
        return _Scan(values[:n], values[n : n + 3], stamp, _flaser_angles(path, number, n), None)
    n = _count(path, number, words, 8)
    _require_words(path, number, words, 9 + n + 1)
    start, step, farthest = (_number(path, number, words[i]) for i in (2, 4, 5))
    m = _count(path, number, words, 9 + n, least=0)
    after = 10 + n + m
    _require_words(path, number, words, after + (14 if words[0] == "ROBOTLASER1" else 3))
    pose = None
    if words[0] == "ROBOTLASER1":
        pose = _numbers(path, number, words[after : after + 3])
        _require_finite(path, number, pose)
    stamp = _number(path, number, words[after + (11 if pose else 0)])
    _require_finite(path, number, [start, step])
    if step == 0:
        raise DataError(f"{path}, line {number}: expected an angular resolution other than zero")
    ranges = _numbers(path, number, words[9 : 9 + n])
    return _Scan(ranges, pose, stamp, (start, step), farthest if farthest > 0 else None)


def _flaser_angles(path: Path, number: int, n: int) -> tuple[float, float]:
    if n < 2:
        raise DataError(f"{path}, line {number}: expected at least two beams, got {n}")
    return -math.pi / 2, math.pi / (n - 1 if n % 2 else n)


def _find_max_range(ranges: FloatArray) -> float:
    seen = ranges[np.isfinite(ranges) & (ranges > 0)]
    if not len(seen):
        return math.inf
    edge = float(seen.max()) * _TOP_SHARE
    top = int((seen >= edge).sum())
    below = int(((seen < edge) & (seen >= edge * _TOP_SHARE)).sum())
    return edge if top >= _PILE_FACTOR * (below + 1) else math.inf


def _count(path: Path, number: int, words: list[str], at: int, least: int = 1) -> int:
    _require_words(path, number, words, at + 1)
    try:
        count = int(words[at])
    except ValueError as error:
        raise DataError(f"{path}, line {number}: expected a count, got {words[at]!r}") from error
    if count < least:
        raise DataError(f"{path}, line {number}: expected a count of at least {least}, got {count}")
    return count


def _require_words(path: Path, number: int, words: list[str], needed: int) -> None:
    if len(words) < needed:
        raise DataError(f"{path}, line {number}: expected {needed} fields or more, got a cut {len(words)}")


def _require_finite(path: Path, number: int, values: list[float]) -> None:
    if not all(map(math.isfinite, values)):
        raise DataError(f"{path}, line {number}: expected a finite pose and angles, got {values}")


def _number(path: Path, number: int, word: str) -> float:
    return _numbers(path, number, [word])[0]


def _numbers(path: Path, number: int, words: list[str]) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError as error:
        raise DataError(f"{path}, line {number}: expected numbers ({error})") from error
