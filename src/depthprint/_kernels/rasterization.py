"""Z-buffer of projected points, and resampling over the valid pixels of a footprint."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["nearest_returns", "resample_footprints"]


@numba.njit(cache=True)
def nearest_returns(
    u: npt.NDArray[np.float64],
    v: npt.NDArray[np.float64],
    ranges_m: npt.NDArray[np.float64],
    height: int,
    width: int,
    wraps: bool,
) -> npt.NDArray[np.float32]:
    """Image (height, width) of the smallest positive range that rounds to each pixel, NaN where none does."""
    image = np.full((height, width), np.nan, dtype=np.float32)
    for i in range(len(u)):
        r = ranges_m[i]
        if not (r > 0.0 and r < np.inf and math.isfinite(u[i]) and math.isfinite(v[i])):
            continue
        row = math.floor(v[i] + 0.5)
        column = math.floor(u[i] + 0.5)
        if wraps and column == width:
            column = 0
        if row < 0 or row >= height or column < 0 or column >= width:
            continue
        a, b = int(row), int(column)
        value = np.float32(r)
        if not image[a, b] <= value:
            image[a, b] = value
    return image


@numba.njit(cache=True)
def _sort_with(values: npt.NDArray[np.float64], weights: npt.NDArray[np.float64], n: int) -> None:
    for i in range(1, n):
        value, weight = values[i], weights[i]
        j = i - 1
        while j >= 0 and values[j] > value:
            values[j + 1] = values[j]
            weights[j + 1] = weights[j]
            j -= 1
        values[j + 1] = value
        weights[j + 1] = weight


@numba.njit(cache=True)
def _heaviest_surface(
    values: npt.NDArray[np.float64], weights: npt.NDArray[np.float64], n: int, edge_ratio: float
) -> tuple[int, int]:
    """Part [first, last) of sorted values without a wide gap: cut at the widest, keep the heavier side."""
    first, last = 0, n
    while True:
        cut, widest = 0, edge_ratio
        for i in range(first + 1, last):
            gap = (values[i] - values[i - 1]) / values[i - 1]
            if gap > widest:
                cut, widest = i, gap
        if cut == 0:
            return first, last
        near, far = 0.0, 0.0
        for i in range(first, cut):
            near += weights[i]
        for i in range(cut, last):
            far += weights[i]
        if near >= far:
            last = cut
        else:
            first = cut


@numba.njit(cache=True)
def resample_footprints(
    image: npt.NDArray[np.float32],
    row_start: npt.NDArray[np.int64],
    row_weights: npt.NDArray[np.float64],
    column_start: npt.NDArray[np.int64],
    column_weights: npt.NDArray[np.float64],
    wraps: bool,
    min_valid_share: float,
    edge_ratio: float,
    median: bool,
) -> npt.NDArray[np.float32]:
    """Mean (or lower median) of the valid pixels of each output pixel's footprint.

    Output row i covers input rows ``row_start[i] + a`` with ``row_weights[i, a]``; columns likewise. Pixels
    outside the image have no weight unless ``wraps`` (columns only).
    """
    height, width = image.shape
    n_rows, n_columns = len(row_start), len(column_start)
    out = np.full((n_rows, n_columns), np.nan, dtype=np.float32)
    capacity = row_weights.shape[1] * column_weights.shape[1]
    values = np.empty(capacity)
    weights = np.empty(capacity)
    for i in range(n_rows):
        for j in range(n_columns):
            n = 0
            inside, valid = 0.0, 0.0
            smallest, largest = np.inf, 0.0
            for a in range(row_weights.shape[1]):
                y = row_start[i] + a
                if row_weights[i, a] <= 0.0 or y < 0 or y >= height:
                    continue
                for b in range(column_weights.shape[1]):
                    weight = row_weights[i, a] * column_weights[j, b]
                    if weight <= 0.0:
                        continue
                    x = column_start[j] + b
                    if wraps:
                        x %= width
                    elif x < 0 or x >= width:
                        continue
                    inside += weight
                    value = np.float64(image[y, x])
                    if value != value:
                        continue
                    valid += weight
                    values[n] = value
                    weights[n] = weight
                    smallest = min(smallest, value)
                    largest = max(largest, value)
                    n += 1
            if n == 0 or valid < min_valid_share * inside:
                continue
            first, last = 0, n
            if median or largest - smallest > edge_ratio * smallest:
                if n <= 64:
                    _sort_with(values, weights, n)
                else:
                    order = np.argsort(values[:n], kind="mergesort")
                    values[:n] = values[:n][order]
                    weights[:n] = weights[:n][order]
                if not median:
                    first, last = _heaviest_surface(values, weights, n, edge_ratio)
            if median:
                mass, k = 0.0, 0
                while k < n - 1 and mass + weights[k] < 0.5 * valid:
                    mass += weights[k]
                    k += 1
                out[i, j] = values[k]
            else:
                total, mass = 0.0, 0.0
                for k in range(first, last):
                    # Differences from the smallest keep equal values exactly equal after averaging.
                    total += weights[k] * (values[k] - smallest)
                    mass += weights[k]
                out[i, j] = smallest + total / mass
    return out
