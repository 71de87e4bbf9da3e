"""A range image as a picture; a laser scan, which has one row, as seen from above."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from depthprint.errors import DataError
from depthprint.projection import LaserRow, Pinhole
from depthprint.range_image import RangeImage
from depthprint.visualization._style import BAD_COLOR, COLORS, DEPTH_MAP, drawing, titled

__all__ = ["draw_range_image"]


def draw_range_image(
    image: RangeImage, path: Path | str, *, data: str = "", simulated: bool = False, what: str = ""
) -> Path:
    """Draw depth in metres, pixels without a return in grey; the colours span the 1st to the 99th percentile.

    Returns the path written. Raises DataError for an image without any return.
    """
    ranges_m = np.asarray(image.ranges_m)
    known = ranges_m[np.isfinite(ranges_m)]
    if not known.size:
        raise DataError(f"{image.source or 'range image'}: expected at least one return, the image has none")
    is_scan = isinstance(image.projection, LaserRow)
    height, width = ranges_m.shape
    height_in = 6.0 if is_scan else float(np.clip(7.0 * height / width, 1.2, 9.0)) + 0.9
    with drawing(path, 7.5, height_in) as figure:
        axes = figure.add_subplot()
        axes.set_title(titled(what or ("Laser scan" if is_scan else "Range image"), data, simulated))
        if is_scan:
            _draw_scan(axes, image, image.projection)
        else:
            low, high = np.percentile(known, [1, 99])
            from matplotlib import colormaps

            colors = colormaps[DEPTH_MAP].with_extremes(bad=BAD_COLOR)
            drawn = axes.imshow(ranges_m, cmap=colors, vmin=low, vmax=high)
            if width > 6 * height:
                axes.set_aspect("auto")
            unit = "depth (m)" if isinstance(image.projection, Pinhole) else "range (m)"
            figure.colorbar(drawn, ax=axes, label=unit, extend="both", shrink=0.85)
            axes.set(xlabel="column (px)", ylabel="row (px)")
    return Path(path)


def _draw_scan(axes: Any, image: RangeImage, projection: Any) -> None:
    azimuth_rad = projection.angle_min_rad + projection.angle_step_rad * np.arange(projection.width)
    ranges_m = np.asarray(image.ranges_m)[0]
    axes.plot(-ranges_m * np.sin(azimuth_rad), ranges_m * np.cos(azimuth_rad), ".", ms=4, color=COLORS[0])
    axes.plot(0, 0, "^", ms=11, color=COLORS[1], label="sensor")
    axes.set(xlabel="to the right (m)", ylabel="forward (m)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="upper right")
