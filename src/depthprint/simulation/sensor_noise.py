"""What sensors make of true ranges: stereo, a Kinect-like camera, a spinning LiDAR. All noise is seeded."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.projection import Pinhole

__all__ = ["kinect_noise", "lidar_noise", "stereo_noise"]

Ranges = npt.NDArray[np.float32]

# KITTI's cameras: 0.54 m apart, 718.9 px at 1241 columns. Errors of matching are given at that resolution.
STEREO_BASELINE_M = 0.54
_STEREO_FULL_FOCAL_PX = 718.9
_STEREO_SIGMA_PX = 0.35
_STEREO_STEP_PX = 1 / 16
_STEREO_LOST = 0.01
# A structured-light camera as measured by Khoshelham and Elberink 2012: 7.5 cm, 575.8 px, disparity in 1/8 px.
KINECT_BASELINE_M = 0.075
_KINECT_FULL_FOCAL_PX = 575.8
_KINECT_SIGMA_PX = 0.08
_KINECT_STEP_PX = 1 / 8
_LIDAR_SIGMA_M = 0.02
_LIDAR_LOST = 0.02


def stereo_noise(
    ranges_m: Ranges,
    projection: Pinhole,
    rng: np.random.Generator,
    *,
    near_m: float = 2.0,
    far_m: float = 80.0,
) -> Ranges:
    """Depth as stereo matching gives it: (h, w) float32 metres, NaN where it gives none.

    Disparity has noise in patches and per pixel and comes in 1/16 px of the full image; what only the left camera
    sees, what is too near or too far and a few pixels at random are lost.
    """
    from scipy.ndimage import gaussian_filter

    disparity = _STEREO_FULL_FOCAL_PX * STEREO_BASELINE_M / ranges_m
    patches = gaussian_filter(rng.standard_normal(ranges_m.shape), 2.0) * 7.0
    noise = _STEREO_SIGMA_PX * (0.7 * patches + 0.7 * rng.standard_normal(ranges_m.shape))
    seen = _seen_by_both(projection.fx * STEREO_BASELINE_M / ranges_m)
    seen &= rng.random(ranges_m.shape) >= _STEREO_LOST
    measured = _quantised(disparity + noise, _STEREO_STEP_PX)
    return _within(_STEREO_FULL_FOCAL_PX * STEREO_BASELINE_M / measured, seen, near_m, far_m)


def kinect_noise(
    ranges_m: Ranges,
    projection: Pinhole,
    rng: np.random.Generator,
    *,
    near_m: float = 0.5,
    far_m: float = 8.0,
) -> Ranges:
    """Depth as a structured-light camera gives it: disparity in steps of 1/8 px, shadows of the projector as holes."""
    disparity = _KINECT_FULL_FOCAL_PX * KINECT_BASELINE_M / ranges_m
    noise = _KINECT_SIGMA_PX * rng.standard_normal(ranges_m.shape)
    seen = _seen_by_both(projection.fx * KINECT_BASELINE_M / ranges_m)
    measured = _quantised(disparity + noise, _KINECT_STEP_PX)
    return _within(_KINECT_FULL_FOCAL_PX * KINECT_BASELINE_M / measured, seen, near_m, far_m)


def lidar_noise(
    ranges_m: Ranges, rng: np.random.Generator, *, near_m: float = 1.0, far_m: float = 100.0
) -> Ranges:
    """Ranges of a laser: 2 cm of noise, a few returns lost."""
    measured = ranges_m + _LIDAR_SIGMA_M * rng.standard_normal(ranges_m.shape)
    return _within(measured, rng.random(ranges_m.shape) >= _LIDAR_LOST, near_m, far_m)


def _quantised(disparity: npt.NDArray[np.float64], step: float) -> npt.NDArray[np.float64]:
    steps = np.round(disparity / step)
    return np.where(steps > 0, steps, np.nan) * step


def _seen_by_both(disparity_px: npt.NDArray[np.floating]) -> npt.NDArray[np.bool_]:
    """Pixels that no nearer surface hides from the second viewpoint, and that fall into its image."""
    columns = np.arange(disparity_px.shape[1])
    landing = np.where(np.isfinite(disparity_px), columns - disparity_px, np.inf)
    to_the_right = np.minimum.accumulate(landing[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(landing.shape, dtype=bool)
    hidden[:, :-1] = landing[:, :-1] > to_the_right[:, 1:]
    return ~hidden & (landing >= 0)


def _within(
    measured: npt.NDArray[np.float64], seen: npt.NDArray[np.bool_], near_m: float, far_m: float
) -> Ranges:
    with np.errstate(invalid="ignore"):
        kept = seen & (measured >= near_m) & (measured <= far_m)
    return np.where(kept, measured, np.nan).astype(np.float32)
