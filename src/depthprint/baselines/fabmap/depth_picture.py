"""Depth as an 8-bit picture that a camera's features can be found in, as the paper gave it to FAB-MAP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import SettingsError
from depthprint.projection import LaserRow
from depthprint.range_image import RangeImage
from depthprint.resampling import fill_holes, resample

__all__ = ["DepthPicture"]


@dataclass(frozen=True)
class DepthPicture:
    """How depth becomes grey: its logarithm between ``near_m`` and ``far_m``, clipped, nearer is brighter.

    width: pixels; the height keeps the image's aspect, down to ``least_height`` rows. Holes take their nearest
    neighbour's depth. A planar scan has no picture of its own: its returns, and the free space before them, are
    drawn from above, ``far_m`` to each side, in width x width pixels. smoothing: Gaussian blur in pixels.

    Raises SettingsError for values that cannot be.
    """

    near_m: float = 2.0
    far_m: float = 50.0
    width: int = 320
    least_height: int = 128
    smoothing: float = 1.0

    def __post_init__(self) -> None:
        if (
            not 0 < self.near_m < self.far_m
            or self.width < 16
            or self.least_height < 16
            or self.smoothing < 0
        ):
            raise SettingsError(
                "DepthPicture: expected 0 < near_m < far_m, width and least_height >= 16 and smoothing >= 0, got "
                f"{self.near_m}, {self.far_m}, {self.width}, {self.least_height} and {self.smoothing}"
            )

    def __call__(self, image: RangeImage) -> npt.NDArray[np.uint8]:
        """Grey picture (height, width) uint8 of a frame; DataError, naming it, when it has no return."""
        from scipy.ndimage import gaussian_filter

        image.require_returns()
        if isinstance(image.projection, LaserRow):
            bright = self._from_above(image)
        else:
            rows, columns = image.shape
            height = max(self.least_height, round(self.width * rows / columns))
            depth = fill_holes(resample(image, self.width, height).ranges_m).astype(np.float64)
            span = np.log(self.far_m / self.near_m)
            bright = 1.0 - np.clip(np.log(depth / self.near_m) / span, 0.0, 1.0)
        if self.smoothing:
            bright = gaussian_filter(bright, self.smoothing)
        return np.asarray(np.round(255 * bright / max(float(bright.max()), 1e-9)), dtype=np.uint8)

    def _from_above(self, image: RangeImage) -> npt.NDArray[np.float64]:
        """Returns white, the free space between them and the scanner grey."""
        import cv2

        points = image.points_flu().reshape(-1, 3)
        points = points[np.isfinite(points[:, 0])].astype(np.float64)
        pixel_m = 2 * self.far_m / self.width
        # columns to the right, rows downward: x is forward and up, y to the left
        outline = np.stack([self.far_m - points[:, 1], self.far_m - points[:, 0]], axis=1) / pixel_m
        pixels = np.floor(np.clip(outline, -(10 * self.width), 10 * self.width)).astype(np.int32)
        plan = np.zeros((self.width, self.width), dtype=np.float64)
        middle = np.array([[self.width // 2, self.width // 2]], dtype=np.int32)
        cv2.fillPoly(plan, [np.concatenate([middle, pixels])], 0.5)
        inside = ((pixels >= 0) & (pixels < self.width)).all(axis=1)
        plan[pixels[inside, 1], pixels[inside, 0]] = 1.0
        return plan
