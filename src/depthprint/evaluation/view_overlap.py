"""How much of one view another one shows, by reprojecting depth with known poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import RangeSequence
from depthprint.errors import DataError, SettingsError
from depthprint.projection import Pinhole

__all__ = ["ViewOverlaps", "view_overlaps"]

_SOURCE_COLUMNS = 80
_TARGET_COLUMNS = 320


@dataclass(frozen=True)
class ViewOverlaps:
    """Overlap of every candidate pair; zero elsewhere.

    forward: (n, n) float32, share of the query's (row's) returns that the candidate (column) confirms.
    backward: (n, n) float32, share of the candidate's returns that the query confirms.
    """

    forward: npt.NDArray[np.float32]
    backward: npt.NDArray[np.float32]


def view_overlaps(
    sequence: RangeSequence,
    gap: int,
    tolerance_m: float = 0.10,
    progress: Callable[[int, int], None] | None = None,
) -> ViewOverlaps:
    """Measure the view overlap of every pair ``i - j > gap`` of a pinhole sequence, both ways.

    A return of one frame is confirmed when it projects into the other and lies within ``tolerance_m`` (depth
    along the optical axis) of the surface seen there: hidden points, holes and points outside confirm
    nothing. About 80 columns of one frame are looked up among about 320 of the other. Frames are held in
    memory thinned out.
    Raises DataError (no poses, sizes that differ), SettingsError (not a pinhole camera).
    """
    from depthprint._kernels.overlap import overlap_row

    if sequence.poses is None:
        raise DataError(f"{sequence.name}: view overlap needs poses, and the sequence has none")
    finite = np.isfinite(sequence.poses).all(axis=(1, 2))
    if not finite.all():
        raise DataError(f"{sequence.name}: the pose of frame {int(np.argmin(finite))} is not finite")
    n = len(sequence)
    poses = np.ascontiguousarray(sequence.poses, dtype=np.float64)
    frames = _Frames.read(sequence, poses, tolerance_m, progress)
    forward = np.zeros((n, n), dtype=np.float32)
    backward = np.zeros((n, n), dtype=np.float32)
    for i in range(gap + 1, n):
        overlap_row(
            i,
            i - gap,
            frames.points,
            frames.counts,
            frames.depths_m,
            poses,
            frames.camera,
            frames.boxes_m,
            frames.margins_m,
            float(tolerance_m),
            forward[i],
            backward[i],
        )
        if progress is not None:
            progress(n + i + 1, 2 * n)
    return ViewOverlaps(forward, backward)


@dataclass(frozen=True)
class _Frames:
    points: npt.NDArray[np.float32]
    counts: npt.NDArray[np.int64]
    depths_m: npt.NDArray[np.float32]
    camera: npt.NDArray[np.float64]
    boxes_m: npt.NDArray[np.float64]
    margins_m: npt.NDArray[np.float64]

    @staticmethod
    def read(
        sequence: RangeSequence,
        poses: npt.NDArray[np.float64],
        tolerance_m: float,
        progress: Callable[[int, int], None] | None,
    ) -> _Frames:
        n = len(sequence)
        camera = sequence[0].projection
        if not isinstance(camera, Pinhole):
            raise SettingsError(
                f"{sequence.name}: ground truth by view overlap needs a pinhole camera, got "
                f"{type(camera).__name__}; use the kind 'distance'"
            )
        thin = max(1, round(camera.width / _TARGET_COLUMNS))
        thinner = max(1, round(camera.width / thin / _SOURCE_COLUMNS))
        columns, rows = np.arange(0, camera.width, thin), np.arange(0, camera.height, thin)
        x_slope, y_slope = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
        depths_m = np.empty((n, len(rows), len(columns)), dtype=np.float32)
        grid = np.ix_(rows[::thinner], columns[::thinner])
        points = np.zeros((n, grid[0].size * grid[1].size, 3), dtype=np.float32)
        counts = np.zeros(n, dtype=np.int64)
        boxes_m = np.zeros((n, 2, 3))
        margins_m = np.zeros(n)
        slope = max(np.abs(x_slope).max(), np.abs(y_slope).max())
        for i in range(n):
            image = sequence[i]
            if image.projection != camera:
                raise DataError(f"{sequence.name}, frame {i}: its camera differs from that of frame 0")
            z = np.asarray(image.ranges_m[::thin, ::thin], dtype=np.float32)
            depths_m[i] = z
            cloud = np.stack([z * x_slope, z * y_slope[:, None], z], axis=-1)
            sample = cloud[::thinner, ::thinner].reshape(-1, 3)
            sample = sample[np.isfinite(sample[:, 2])]
            counts[i] = len(sample)
            points[i, : len(sample)] = sample
            seen = cloud[np.isfinite(z)]
            if len(seen):
                world = seen @ poses[i, :3, :3].T + poses[i, :3, 3]
                boxes_m[i] = world.min(axis=0), world.max(axis=0)
                # a confirmed point is off by the tolerance along its ray and by a pixel of the thinned image
                pixel_m = (seen[:, 2].max() + tolerance_m) * thin / min(camera.fx, camera.fy)
                margins_m[i] = 2 * (tolerance_m * np.sqrt(1 + 2 * slope**2) + pixel_m)
            if progress is not None:
                progress(i + 1, 2 * n)
        thinned = np.array([camera.fx, camera.fy, camera.cx, camera.cy], dtype=np.float64) / thin
        return _Frames(points, counts, depths_m, thinned, boxes_m, margins_m)
