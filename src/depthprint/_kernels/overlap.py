"""Share of one pinhole view that another confirms, by reprojecting depth."""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

__all__ = ["overlap_row"]

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]


@nb.njit(cache=True)
def _share_confirmed(
    points: Float32,
    n_points: int,
    rotation: Float64,
    translation: Float64,
    camera: Float64,
    depth: Float32,
    tolerance: float,
) -> float:
    height, width = depth.shape
    fx, fy, cx, cy = camera
    confirmed = 0
    for k in range(n_points):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        z_new = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + translation[2]
        if z_new <= 1e-6:
            continue
        x_new = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + translation[0]
        y_new = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + translation[1]
        u = fx * x_new / z_new + cx + 0.5
        v = fy * y_new / z_new + cy + 0.5
        if u < 0 or v < 0 or u >= width or v >= height:
            continue
        # a comparison with NaN (no return there) is false: nothing confirmed
        if abs(depth[int(v), int(u)] - z_new) <= tolerance:
            confirmed += 1
    return confirmed / n_points


@nb.njit(cache=True, parallel=True)
def overlap_row(
    query: int,
    n_candidates: int,
    points: Float32,
    counts: npt.NDArray[np.int64],
    depths: Float32,
    poses: Float64,
    camera: Float64,
    boxes: Float64,
    margins: Float64,
    tolerance: float,
    forward: Float32,
    backward: Float32,
) -> None:
    """Fill ``forward[j]`` (query's points seen by candidate j) and ``backward[j]`` (the other way round).

    points (n, p, 3) in sensor frames, of which counts[i] are real; depths (n, h, w); poses (n, 4, 4)
    T_world_sensor; camera (4,) fx fy cx cy of ``depths``; boxes (n, 2, 3) world bounds of what each frame
    sees; margins (n,): pairs whose boxes are further apart than both margins cannot confirm a point.
    """
    for j in nb.prange(n_candidates):
        forward[j] = 0.0
        backward[j] = 0.0
        apart = counts[query] == 0 or counts[j] == 0
        margin = max(margins[query], margins[j])
        for axis in range(3):
            if (
                boxes[query, 0, axis] > boxes[j, 1, axis] + margin
                or boxes[j, 0, axis] > boxes[query, 1, axis] + margin
            ):
                apart = True
        if apart:
            continue
        rotation_q, rotation_j = poses[query, :3, :3], poses[j, :3, :3]
        rotation = np.zeros((3, 3))
        offset = np.zeros(3)
        there = np.zeros(3)
        back = np.zeros(3)
        for a in range(3):
            offset[a] = poses[query, a, 3] - poses[j, a, 3]
        for a in range(3):
            for c in range(3):
                there[a] += rotation_j[c, a] * offset[c]
                back[a] -= rotation_q[c, a] * offset[c]
                for b in range(3):
                    rotation[a, b] += rotation_j[c, a] * rotation_q[c, b]
        forward[j] = _share_confirmed(
            points[query], counts[query], rotation, there, camera, depths[j], tolerance
        )
        backward[j] = _share_confirmed(
            points[j], counts[j], rotation.T, back, camera, depths[query], tolerance
        )
