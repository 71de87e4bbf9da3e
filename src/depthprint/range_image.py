"""RangeImage: metric depth with its projection; NaN is 'no return'."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.projection import LaserRow, Pinhole, Projection, Spherical

__all__ = ["RangeImage"]


@dataclass(frozen=True, eq=False)
class RangeImage:
    """One frame of depth.

    ranges_m: (height, width) float32 metres, NaN = no return; z for a Pinhole, Euclidean range otherwise;
        read-only. Values that are not positive and finite become NaN.
    projection: how pixels become points.
    stamp_s: time in seconds, or None.
    sensor_height_m: height of the sensor above level ground, if known. Not None also states that the sensor
        is mounted level, so that a bird's-eye view can be made.
    mask: (height, width) bool, true on the object (crops of objects), or None.
    source: where the frame came from (file, index), for error messages.

    Raises DataError when the parts do not fit each other. Images compare and hash by identity.
    """

    ranges_m: npt.NDArray[np.float32]
    projection: Projection
    stamp_s: float | None = None
    sensor_height_m: float | None = None
    mask: npt.NDArray[np.bool_] | None = None
    source: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.projection, (Pinhole, Spherical, LaserRow)):
            raise DataError(
                f"{self._name}: expected a Pinhole, Spherical or LaserRow projection, "
                f"got {type(self.projection).__name__}"
            )
        object.__setattr__(self, "ranges_m", self._checked_ranges())
        if self.mask is not None:
            object.__setattr__(self, "mask", self._checked_mask(self.mask))
        if self.stamp_s is not None and not math.isfinite(self.stamp_s):
            raise DataError(f"{self._name}: expected a finite stamp_s or None, got {self.stamp_s}")
        height = self.sensor_height_m
        if height is not None and not (math.isfinite(height) and height >= 0):
            raise DataError(f"{self._name}: expected sensor_height_m >= 0 or None, got {height}")

    @classmethod
    def from_points(
        cls,
        points_xyz: npt.ArrayLike,
        projection: Projection,
        *,
        stamp_s: float | None = None,
        sensor_height_m: float | None = None,
        source: str = "",
    ) -> RangeImage:
        """Project (n, 3) points, metres, in the projection's own frame; a pixel keeps its nearest return.

        Points outside the image and points with NaN are left out. Raises DataError for another shape.
        """
        from depthprint._kernels.rasterization import nearest_returns

        u, v, ranges = projection.project(points_xyz)
        wraps = isinstance(projection, Spherical) and projection.wraps
        image = nearest_returns(
            u, v, np.ascontiguousarray(ranges), int(projection.height), int(projection.width), wraps
        )
        return cls(image, projection, stamp_s=stamp_s, sensor_height_m=sensor_height_m, source=source)

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width)."""
        return self.projection.height, self.projection.width

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """(height, width) bool: where there is a return."""
        return np.isfinite(self.ranges_m)

    def require_returns(self) -> RangeImage:
        """The image itself; raises DataError naming its source when no pixel holds a return."""
        if not self.valid.any():
            raise DataError(f"{self._name}: expected at least one return, got none in {self.shape} pixels")
        return self

    def points(self) -> npt.NDArray[np.float32]:
        """(height, width, 3) float32 points in the projection's sensor frame, metres; NaN = no return."""
        return self.projection.points(self.ranges_m)

    def points_flu(self) -> npt.NDArray[np.float32]:
        """(height, width, 3) float32 points in the frame x forward, y left, z up, metres; NaN = no return."""
        points = self.points()
        if isinstance(self.projection, Pinhole):
            return np.stack([points[..., 2], -points[..., 0], -points[..., 1]], axis=-1)
        return points

    def cropped(self, left: int, top: int, width: int, height: int) -> RangeImage:
        """A window of a pinhole image with its mask; raises DataError for other projections."""
        if not isinstance(self.projection, Pinhole):
            raise DataError(
                f"{self._name}: only pinhole images can be cropped, got {type(self.projection).__name__}"
            )
        projection = self.projection.cropped(left, top, width, height)
        window = (slice(top, top + height), slice(left, left + width))
        mask = None if self.mask is None else self.mask[window]
        return self.replace(ranges_m=self.ranges_m[window], projection=projection, mask=mask)

    def replace(self, **changes: Any) -> RangeImage:
        """A copy with some fields changed, validated again; raises DataError for an unknown field."""
        known = {f.name for f in dataclasses.fields(self)}
        unknown = sorted(set(changes) - known)
        if unknown:
            raise DataError(f"RangeImage.replace: expected some of {sorted(known)}, got {unknown}")
        return dataclasses.replace(self, **changes)

    @property
    def _name(self) -> str:
        return self.source or "RangeImage"

    def _checked_ranges(self) -> npt.NDArray[np.float32]:
        raw = np.asarray(self.ranges_m)
        if raw.dtype.kind not in "fiu":
            raise DataError(f"{self._name}: expected ranges_m of real numbers, got dtype {raw.dtype}")
        if raw.shape != self.shape:
            raise DataError(
                f"{self._name}: expected ranges_m of shape {self.shape}, as its projection, got {raw.shape}"
            )
        with np.errstate(over="ignore"):
            ranges = np.array(raw, dtype=np.float32)
        ranges[~((ranges > 0) & (ranges < np.inf))] = np.nan
        ranges.setflags(write=False)
        return ranges

    def _checked_mask(self, mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        checked = np.array(mask)
        if checked.dtype != np.bool_ or checked.shape != self.shape:
            raise DataError(
                f"{self._name}: expected a bool mask of {self.shape}, got {checked.dtype} {checked.shape}"
            )
        checked.setflags(write=False)
        return checked
