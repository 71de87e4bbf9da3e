"""Routes: where the simulated vehicle is in each frame, on level ground."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = ["Route", "built_in_route", "check_seed", "route_from_kitti_poses"]

FloatArray = npt.NDArray[np.float64]

FRAME_SPACING_M = 0.8
MIN_LENGTH_M = 300.0
_LANE_OFFSET_M = 1.7
_CORNER_RADIUS_M = 9.0


@dataclass(frozen=True)
class Route:
    """Frames along a drive: ``positions_m`` (n, 2) and ``headings_rad`` (n,), float64, world x-y plane, read-only."""

    positions_m: FloatArray
    headings_rad: FloatArray

    def __post_init__(self) -> None:
        positions = np.array(self.positions_m, dtype=np.float64)
        headings = np.array(self.headings_rad, dtype=np.float64)
        if positions.ndim != 2 or positions.shape[1] != 2 or headings.shape != positions.shape[:1]:
            raise DataError(
                f"Route: expected positions (n, 2) and headings (n,), got {positions.shape}, {headings.shape}"
            )
        if len(positions) < 2:
            raise DataError(f"Route: expected at least two frames, got {len(positions)}")
        if not (np.isfinite(positions).all() and np.isfinite(headings).all()):
            raise DataError("Route: positions and headings must be finite")
        for name, array in (("positions_m", positions), ("headings_rad", headings)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.positions_m)

    @property
    def arc_m(self) -> FloatArray:
        """Distance driven up to each frame, (n,) metres."""
        steps = np.hypot(*np.diff(self.positions_m, axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])


def route_from_kitti_poses(path: Path | str) -> Route:
    """Horizontal motion of a KITTI pose file (rows of 3x4 camera-to-world; x right, y down, z forward).

    The world is turned so that z is up: x = KITTI's z, y = minus KITTI's x; heights are dropped, since the
    official poses drift. Raises DataError naming the file and line.
    """
    from depthprint.io.poses import read_kitti_poses

    poses = read_kitti_poses(path)
    if len(poses) < 2:
        raise DataError(f"{path}: expected at least two poses to drive along, got {len(poses)}")
    flat_forward = np.hypot(poses[:, 0, 2], poses[:, 2, 2])
    tilted = np.flatnonzero(flat_forward < 0.5)
    if len(tilted):
        raise DataError(
            f"{path}: pose {tilted[0] + 1} looks up or down by more than 60 degrees; expected a vehicle"
        )
    return Route(
        np.stack([poses[:, 2, 3], -poses[:, 0, 3]], axis=1),
        np.arctan2(-poses[:, 0, 2], poses[:, 2, 2]),
    )


def built_in_route(length_m: float = 1500.0, seed: int = 0) -> Route:
    """A round of four streets driven twice, then a smaller round, then the first one in the other direction.

    ``length_m``: distance driven, at least 300; the streets grow with it. Traffic keeps to the right, so that the
    opposite direction runs 3.4 m beside the first. Frames are 0.8 m apart. Raises SettingsError.
    """
    if not (math.isfinite(length_m) and length_m >= MIN_LENGTH_M):
        raise SettingsError(f"length_m: expected at least {MIN_LENGTH_M:g} metres, got {length_m}")
    check_seed(seed)
    rng = np.random.default_rng([seed, 7301])
    nodes = _town_nodes(rng)
    order = "ABCDABCDAFEGADCBA"
    # The lane offset and the corners do not grow with the town, so that the scale is found by a few corrections.
    scale = length_m / 1440.0
    bends: dict[str, FloatArray] = {}
    for first, second in pairwise(order):
        key = "".join(sorted(first + second))
        bends.setdefault(key, rng.normal(0.0, 0.035, 2))
    wobble = rng.uniform(0, 2 * math.pi, 3)
    line: FloatArray = np.zeros((2, 2))
    for _ in range(6):
        line = _drive(nodes, order, bends, scale, wobble)
        scale *= length_m / float(np.hypot(*np.diff(line, axis=0).T).sum())
    positions = _resampled(line, FRAME_SPACING_M)
    step = np.gradient(positions, axis=0)
    return Route(positions, np.arctan2(step[:, 1], step[:, 0]))


def check_seed(seed: int) -> None:
    """Raise SettingsError unless ``seed`` is an integer of at least 0."""
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise SettingsError(f"seed: expected an integer >= 0, got {seed!r}")


def _town_nodes(rng: np.random.Generator) -> dict[str, FloatArray]:
    layout = {
        "A": (0, 0),
        "B": (112, 0),
        "C": (112, 84),
        "D": (0, 84),
        "F": (0, -62),
        "E": (-72, -62),
        "G": (-72, 0),
    }
    return {name: np.array(xy, dtype=float) + rng.uniform(-9, 9, 2) for name, xy in layout.items()}


def _drive(
    nodes: dict[str, FloatArray], order: str, bends: dict[str, FloatArray], scale: float, wobble: FloatArray
) -> FloatArray:
    points = [nodes[order[0]] * scale]
    for first, second in pairwise(order):
        low, high = sorted(first + second)
        a, b = nodes[low] * scale, nodes[high] * scale
        normal = np.array([a[1] - b[1], b[0] - a[0]])
        inner = [
            a + t * (b - a) + bend * normal for t, bend in zip((0.33, 0.67), bends[low + high], strict=True)
        ]
        points += [*(inner if first == low else inner[::-1]), nodes[second] * scale]
    dense = _resampled(np.array(points), 0.5)
    # A moving average rounds the corners as a driver would.
    half = int(_CORNER_RADIUS_M / 0.5)
    window = np.hanning(2 * half + 1)
    padded = np.concatenate([np.repeat(dense[:1], half, 0), dense, np.repeat(dense[-1:], half, 0)])
    smooth = np.stack([np.convolve(padded[:, k], window / window.sum(), "valid") for k in range(2)], axis=1)
    smooth = _resampled(smooth, 0.5)
    tangent = np.gradient(smooth, axis=0)
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-9)[:, None]
    arc = np.arange(len(smooth)) * 0.5
    sway = sum(
        0.15 * np.sin(arc / period + phase) for period, phase in zip((11.0, 23.0, 41.0), wobble, strict=True)
    )
    right = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    return smooth + right * (_LANE_OFFSET_M + np.asarray(sway))[:, None]


def _resampled(line: FloatArray, spacing_m: float) -> FloatArray:
    steps = np.hypot(*np.diff(line, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    keep = np.concatenate([[True], steps > 1e-9])
    at = np.arange(0.0, arc[-1], spacing_m)
    return np.stack([np.interp(at, arc[keep], line[keep, k]) for k in range(2)], axis=1)
