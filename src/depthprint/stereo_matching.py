"""Depth from a rectified stereo pair by semi-global matching."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = ["SemiGlobalMatching", "sgbm_depth"]


@dataclass(frozen=True)
class SemiGlobalMatching:
    """Settings of the matcher; the defaults suit street scenes of about 1240 x 376 pixels.

    max_disparity_px: largest disparity searched, a multiple of 16.
    block_size_px: side of the matched block, odd.
    uniqueness_percent: margin by which the best match must beat the second.
    speckle_size_px, speckle_range_px: smaller patches of one disparity, within the range, are dropped.
    max_depth_m: depth beyond it is 'no return', since its error grows with its square.
    """

    max_disparity_px: int = 128
    block_size_px: int = 5
    uniqueness_percent: int = 10
    speckle_size_px: int = 100
    speckle_range_px: int = 2
    max_depth_m: float = 80.0

    def __post_init__(self) -> None:
        if self.max_disparity_px < 16 or self.max_disparity_px % 16:
            raise SettingsError(
                f"max_disparity_px: expected a positive multiple of 16, got {self.max_disparity_px}"
            )
        if self.block_size_px < 1 or self.block_size_px % 2 == 0:
            raise SettingsError(f"block_size_px: expected an odd number >= 1, got {self.block_size_px}")
        if min(self.uniqueness_percent, self.speckle_size_px, self.speckle_range_px) < 0:
            raise SettingsError("uniqueness_percent, speckle_size_px, speckle_range_px: expected values >= 0")
        if not self.max_depth_m > 0:
            raise SettingsError(f"max_depth_m: expected a positive depth, got {self.max_depth_m}")


def sgbm_depth(
    left: npt.NDArray[np.uint8],
    right: npt.NDArray[np.uint8],
    *,
    focal_px: float,
    baseline_m: float,
    settings: SemiGlobalMatching | None = None,
    source: str = "stereo pair",
) -> npt.NDArray[np.float32]:
    """Depth of the left image: z = focal_px * baseline_m / disparity.

    left, right: (height, width) uint8 grey, rectified, rows aligned. Returns (height, width) float32 metres,
    NaN where no match was found, where it would lie outside the right image, and beyond ``max_depth_m``.
    Raises DataError for images of other type, of two sizes or smaller than a block, naming ``source``;
    SettingsError for a focal length or baseline that is not positive. Matcher: Hirschmueller, 'Stereo
    processing by semiglobal matching and mutual information', PAMI 2008, in OpenCV's three-pass form.
    """
    chosen = settings or SemiGlobalMatching()
    for name, value in (("focal_px", focal_px), ("baseline_m", baseline_m)):
        if not (math.isfinite(value) and value > 0):
            raise SettingsError(f"sgbm_depth: expected {name} > 0, got {value}")
    for side, image in (("left", left), ("right", right)):
        if image.ndim != 2 or image.dtype != np.uint8:
            raise DataError(f"{source}: expected a grey uint8 {side} image, got {image.dtype} {image.shape}")
    if left.shape != right.shape:
        raise DataError(f"{source}: left image is {left.shape} but right image is {right.shape}")
    if min(left.shape) < chosen.block_size_px:
        raise DataError(
            f"{source}: images {left.shape} are smaller than the block, {chosen.block_size_px} px"
        )
    disparity_px = _disparity(left, right, chosen)
    columns = np.arange(left.shape[1], dtype=np.float32)
    unseen = columns[None, :] - disparity_px < 0
    disparity_px[unseen | (disparity_px * chosen.max_depth_m < focal_px * baseline_m)] = np.nan
    return np.asarray(focal_px * baseline_m / disparity_px, dtype=np.float32)


def _disparity(
    left: npt.NDArray[np.uint8], right: npt.NDArray[np.uint8], settings: SemiGlobalMatching
) -> npt.NDArray[np.float32]:
    import cv2

    opencv: Any = cv2  # its stubs lack the stereo matchers
    area = settings.block_size_px**2
    matcher = opencv.StereoSGBM_create(
        minDisparity=0,
        numDisparities=settings.max_disparity_px,
        blockSize=settings.block_size_px,
        P1=8 * area,
        P2=32 * area,
        disp12MaxDiff=1,
        uniquenessRatio=settings.uniqueness_percent,
        speckleWindowSize=settings.speckle_size_px,
        speckleRange=settings.speckle_range_px,
        mode=opencv.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    # OpenCV leaves the first max_disparity columns unmatched; a border moves them out of the image.
    pad = settings.max_disparity_px
    padded = [cv2.copyMakeBorder(side, 0, 0, pad, 0, cv2.BORDER_REPLICATE) for side in (left, right)]
    fixed_point = matcher.compute(*padded)[:, pad:]
    disparity_px = fixed_point.astype(np.float32) / 16.0
    disparity_px[disparity_px <= 0] = np.nan
    return np.asarray(disparity_px)
