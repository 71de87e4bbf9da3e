"""Greatest heights and counts of a range image's returns on a polar grid, in one pass over its pixels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["fill_polar_grid"]

Float64 = npt.NDArray[np.float64]


@njit(cache=True, nogil=True)
def fill_polar_grid(
    ranges: npt.NDArray[np.float32],
    planar: Float64,
    upward: Float64,
    sectors_of: npt.NDArray[np.int64],
    sensor_height: float,
    lowest: float,
    edges: Float64,
    n_sectors: int,
    bands: Float64,
    top: Float64,
    counts: Float64,
) -> None:
    """Raise top (cells,) to the greatest height and add to counts (bands, cells); cell = ring * n_sectors + sector.

    A pixel's return lies ``planar`` times its range from the sensor along the ground and ``upward`` times it above, in
    sector ``sectors_of`` (-1: none); ranges, planar, upward, sectors_of are (h, w). Returns not above ``lowest`` are
    left out. edges (rings + 1,): radii between rings. bands (n, 2): heights counted, the upper end not included.
    """
    rings = len(edges) - 1
    for i in range(ranges.shape[0]):
        for j in range(ranges.shape[1]):
            reach = np.float64(ranges[i, j])
            height = reach * upward[i, j] + sensor_height
            sector = sectors_of[i, j]
            # false for NaN too
            if not height > lowest or sector < 0:
                continue
            distance = reach * planar[i, j]
            if not distance < edges[rings]:
                continue
            low, high = 0, rings
            while high - low > 1:
                middle = (low + high) // 2
                if edges[middle] <= distance:
                    low = middle
                else:
                    high = middle
            cell = low * n_sectors + sector
            if height > top[cell]:
                top[cell] = height
            for band in range(len(bands)):
                if bands[band, 0] <= height < bands[band, 1]:
                    counts[band, cell] += 1.0
