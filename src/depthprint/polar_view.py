"""The bird's-eye view: a polar grid about a level sensor, with heights, counts and line directions."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.errors import SettingsError
from depthprint.projection import LaserRow, Projection
from depthprint.range_image import RangeImage
from depthprint.settings import PolarSettings

FloatArray = npt.NDArray[np.float64]

__all__ = ["POLAR_CHANNELS", "polar_view", "turn_of_shift"]

POLAR_CHANNELS = ("height", "low-count", "high-count", "count", "line-cos", "line-sin")
# Counts depend on the sensor's resolution; they are brought to those of an image of this many pixels.
_NOMINAL_PIXELS = 30_000
_NOMINAL_BEAMS = 360
# Where the sensor's height is not known, a hand-held or small robot's height is assumed.
_ASSUMED_HEIGHT_M = 1.2


def turn_of_shift(shift: float, sectors: int) -> float:
    """Turn of T_match_query about 'up', radians, of a query moved by ``shift`` of the ``sectors`` of a full circle.

    Sectors are counted clockwise, and the shift moves the query's.
    """
    return -2 * math.pi * shift / sectors


def polar_view(
    image: RangeImage, settings: PolarSettings, channels: tuple[str, ...]
) -> npt.NDArray[np.float32]:
    """Rasterise a frame's points on the polar grid.

    Returns (len(channels), rings, sectors) float32; sector 0 is the leftmost. 'height': greatest height above ground
    in a cell, clipped, as a share of the ceiling. 'low-count', 'high-count', 'count': log of one plus the returns in a
    band of heights, or of all above the ground. 'line-cos', 'line-sin': count-weighted cosine and sine of twice the
    direction of the line through neighbouring returns, for planar scans. Raises SettingsError on an unknown channel.
    """
    unknown = [name for name in channels if name not in POLAR_CHANNELS]
    if unknown:
        raise SettingsError(
            f"polar view: expected channels among {', '.join(POLAR_CHANNELS)}, got {unknown[0]!r}"
        )
    lines = any(name.startswith("line") for name in channels)
    # Few returns, or their order matters: point by point; a whole image goes by the fixed cells of its rays.
    pointwise = lines or isinstance(image.projection, LaserRow)
    make = _grid_of_points if pointwise else _grid_of_rays
    values = np.stack(make(image, settings, channels))
    return _smooth(values.reshape(-1, settings.rings, settings.sectors), settings).astype(np.float32)


def _grid_of_rays(image: RangeImage, settings: PolarSettings, channels: tuple[str, ...]) -> list[FloatArray]:
    """Channels (cells,) of what is above the ground; a pixel's sector, and its way out and up, are known beforehand."""
    from depthprint._kernels.polar_grid import fill_polar_grid

    bands = {
        "low-count": settings.low_band_m,
        "high-count": settings.high_band_m,
        "count": (-math.inf, math.inf),
    }
    counted = [name for name in channels if name in bands]
    n_cells = settings.rings * settings.sectors
    top, counts = np.zeros(n_cells), np.zeros((len(counted), n_cells))
    rays = _polar_rays(image.projection, settings.sectors, polar_span(image, settings))
    fill_polar_grid(
        image.ranges_m, *rays, _sensor_height_m(image), settings.ground_clearance_m, ring_edges(settings),
        settings.sectors, np.array([bands[name] for name in counted]).reshape(-1, 2), top, counts,
    )  # fmt: skip
    nominal = _NOMINAL_PIXELS / image.ranges_m.size
    made = dict(zip(counted, np.log1p(counts * nominal), strict=True))
    made["height"] = np.clip(top, 0.0, settings.max_height_m) / settings.max_height_m
    return [made[name] for name in channels]


@lru_cache(maxsize=8)
def _polar_rays(
    projection: Projection, sectors: int, span: float
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]:
    """Metres along the ground and upwards for each metre of range, and the sector or -1: (height, width) each."""
    rays = projection.directions() @ projection.R_flu_sensor.T
    azimuth = np.arctan2(rays[..., 1], rays[..., 0])
    sector = np.floor((span / 2 - azimuth) / span * sectors).astype(np.int64)
    if span >= 2 * math.pi:
        sector %= sectors
    sector[(sector < 0) | (sector >= sectors)] = -1
    made = np.hypot(rays[..., 0], rays[..., 1]), np.ascontiguousarray(rays[..., 2]), sector
    for array in made:
        array.setflags(write=False)
    return made


def _grid_of_points(
    image: RangeImage, settings: PolarSettings, channels: tuple[str, ...]
) -> list[npt.NDArray[np.floating]]:
    """Channels (cells,) of a frame's points: those above the ground, or all of a planar scan's."""
    planar = isinstance(image.projection, LaserRow)
    points = image.points_flu().astype(np.float64)
    height = points[..., 2] + _sensor_height_m(image)
    keep = np.isfinite(points[..., 0])
    if not planar:
        keep &= height > settings.ground_clearance_m
    cell, inside = _cells(points[keep], image, settings)
    height = height[keep][inside]
    n_cells = settings.rings * settings.sectors
    nominal = _NOMINAL_BEAMS / keep.size if planar else _NOMINAL_PIXELS / keep.size
    grid: list[npt.NDArray[np.floating]] = []
    for name in channels:
        if name == "height":
            values: npt.NDArray[np.floating] = np.zeros(n_cells)
            np.maximum.at(values, cell, np.clip(height, 0.0, settings.max_height_m) / settings.max_height_m)
        elif name.startswith("line"):
            angle = _line_angles(points)[keep][inside]
            wave = np.cos(2 * angle) if name == "line-cos" else np.sin(2 * angle)
            values = np.bincount(cell, np.nan_to_num(wave), n_cells) * nominal
            values = np.sign(values) * np.log1p(np.abs(values))
        else:
            band = {"low-count": settings.low_band_m, "high-count": settings.high_band_m}.get(name)
            weight = None if band is None else ((height >= band[0]) & (height < band[1])).astype(np.float64)
            values = np.log1p(np.bincount(cell, weight, n_cells) * nominal)
        grid.append(values)
    return grid


def _sensor_height_m(image: RangeImage) -> float:
    return _ASSUMED_HEIGHT_M if image.sensor_height_m is None else image.sensor_height_m


def polar_span(image: RangeImage, settings: PolarSettings) -> float:
    """Angle that the sectors cover together, in radians."""
    return 2 * math.pi if settings.full_circle else image.projection.horizontal_fov_rad


def _cells(
    points: npt.NDArray[np.float64], image: RangeImage, settings: PolarSettings
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Grid cell of each point, and which points lie on the grid."""
    distance = np.hypot(points[:, 0], points[:, 1])
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    span = polar_span(image, settings)
    sector = np.floor((span / 2 - azimuth) / span * settings.sectors).astype(np.int64)
    if settings.full_circle:
        sector %= settings.sectors
    edges = ring_edges(settings)
    ring = np.searchsorted(edges, distance, side="right") - 1
    inside = (sector >= 0) & (sector < settings.sectors) & (ring >= 0) & (ring < settings.rings)
    return (ring * settings.sectors + sector)[inside], inside


def ring_edges(settings: PolarSettings) -> npt.NDArray[np.float64]:
    """Radii between rings, (rings + 1,) metres; each ring is ``ring_growth`` times as wide as the one inside it."""
    widths = settings.ring_m * settings.ring_growth ** np.arange(settings.rings)
    return np.concatenate([[0.0], np.cumsum(widths)])


def _line_angles(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Direction of the local line at each return of a planar scan; NaN at ends and at jumps."""
    row = points.reshape(-1, points.shape[-1])[:, :2]
    before, after = np.roll(row, 2, axis=0), np.roll(row, -2, axis=0)
    step = after - before
    gap = np.hypot(step[:, 0], step[:, 1])
    reach = np.hypot(row[:, 0], row[:, 1])
    angle = np.arctan2(step[:, 1], step[:, 0])
    angle[~(gap < np.maximum(0.5, 0.2 * reach))] = np.nan
    return angle.reshape(points.shape[:-1])


def _smooth(grid: npt.NDArray[np.float64], settings: PolarSettings) -> npt.NDArray[np.float64]:
    if settings.smoothing <= 0:
        return grid
    from scipy.ndimage import gaussian_filter1d

    grid = gaussian_filter1d(grid, settings.smoothing, axis=1, mode="constant")
    return np.asarray(
        gaussian_filter1d(
            grid, settings.smoothing, axis=2, mode="wrap" if settings.full_circle else "nearest"
        )
    )
