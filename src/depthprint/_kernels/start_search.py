"""Which of many poses to start an alignment from: those under which a view confirms the most points of another."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from depthprint._kernels.pixels import SeenImage, find_pixels, turn_points

__all__ = ["confirmed_shares", "spread_best"]

Float64 = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@njit(cache=True, nogil=True)
def confirmed_shares(
    points: npt.NDArray[np.float32],
    few: int,
    more: int,
    n_best: int,
    slack: float,
    poses: Float64,
    image: SeenImage,
    shares: Float64,
) -> None:
    """Fill shares (m,): of about ``few`` points (n, 3), those that their own pixel of the image confirms.

    poses (m, 4, 4) T_image_points. Tolerances are ``slack`` times the image's. The ``n_best`` poses are asked again,
    with about ``more`` points.
    """
    every: IntArray = np.arange(len(poses))
    _shares_of(every, points, max(1, len(points) // few), slack, poses, image, shares)
    best = np.argsort(-shares, kind="mergesort")[:n_best]
    _shares_of(best, points, max(1, len(points) // more), slack, poses, image, shares)


@njit(cache=True, nogil=True)
def _shares_of(
    chosen: IntArray,
    points: npt.NDArray[np.float32],
    step: int,
    slack: float,
    poses: Float64,
    image: SeenImage,
    shares: Float64,
) -> None:
    a, b, c = slack * image.tolerance[0], slack * image.tolerance[1], slack * image.tolerance[2]
    n = (len(points) + step - 1) // step
    turned, reach = np.empty((3, n)), np.empty(n)
    rows, columns = np.empty(n, np.int64), np.empty(n, np.int64)
    before = np.int64(-1)
    for m in chosen:
        # Many poses of a grid turn alike: only the first of them turns the points.
        if before < 0 or not _turn_alike(poses[m], poses[before]):
            turn_points(poses[m], points, step, turned)
        before = m
        find_pixels(image, turned, poses[m, :3, 3], rows, columns, reach)
        confirmed = 0
        for k in range(n):
            r = reach[k]
            # false for NaN too
            confirmed += abs(np.float64(image.ranges[rows[k], columns[k]]) - r) <= a + b * r + c * r * r
        shares[m] = confirmed / max(1, n)


@njit(cache=True, nogil=True)
def _turn_alike(pose: Float64, other: Float64) -> bool:
    alike = True
    for i in range(3):
        for j in range(3):
            alike = alike & (pose[i, j] == other[i, j])
    return alike


@njit(cache=True, nogil=True)
def spread_best(poses: Float64, shares: Float64, count: int, beside: float) -> IntArray:
    """Up to ``count`` poses of the largest shares (m,), best first; no two matrices differ by ``beside`` or less."""
    order = np.argsort(-shares, kind="mergesort")[: 8 * count]
    chosen = np.empty(count, np.int64)
    n = 0
    for index in order:
        apart = True
        for other in chosen[:n]:
            apart = apart and np.abs(poses[index] - poses[other]).max() > beside
        if apart:
            chosen[n] = index
            n += 1
            if n == count:
                break
    return chosen[:n]
