"""Loops over the points around a point: spin coordinates, and distances shared out among nodes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["mean_distance_shares", "spin_coordinates"]

FloatArray = npt.NDArray[np.float64]


@njit(cache=True, nogil=True)
def spin_coordinates(
    points: FloatArray,
    normals: FloatArray,
    rows: npt.NDArray[np.int64],
    columns: npt.NDArray[np.int64],
    patch: int,
    order: npt.NDArray[np.int64],
    radius: float,
    most: int,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int64]]:
    """Cosine to the centre's normal, distance along it and across it, of points within ``radius`` of the centre.

    The pixels of a patch are visited in ``order`` and the first ``most`` points taken: those of all patches one after
    another (n, 3), and how many each has. Points and centres without a normal are passed over.
    """
    coordinates = np.empty((len(rows) * len(columns) * most, 3), dtype=np.float32)
    counts = np.zeros(len(rows) * len(columns), dtype=np.int64)
    half = patch // 2
    down, across = order // patch, order % patch
    number, used = -1, 0
    for top in rows:
        for left in columns:
            number += 1
            centre, axis = points[top + half, left + half], normals[top + half, left + half]
            if centre[2] <= 0.0 or (axis[0] == 0.0 and axis[1] == 0.0 and axis[2] == 0.0):
                continue
            n = 0
            for place in range(len(order)):
                r, c = top + down[place], left + across[place]
                normal = normals[r, c]
                if points[r, c, 2] <= 0.0 or (normal[0] == 0.0 and normal[1] == 0.0 and normal[2] == 0.0):
                    continue
                dx = points[r, c, 0] - centre[0]
                dy = points[r, c, 1] - centre[1]
                dz = points[r, c, 2] - centre[2]
                squared = dx * dx + dy * dy + dz * dz
                if squared >= radius * radius:
                    continue
                along = axis[0] * dx + axis[1] * dy + axis[2] * dz
                cosine = axis[0] * normal[0] + axis[1] * normal[1] + axis[2] * normal[2]
                coordinates[used + n, 0] = min(1.0, max(-1.0, cosine))
                coordinates[used + n, 1] = along
                coordinates[used + n, 2] = np.sqrt(max(squared - along * along, 0.0))
                n += 1
                if n == most:
                    break
            counts[number] = n
            used += n
    return coordinates[:used], counts


@njit(cache=True, nogil=True)
def mean_distance_shares(centres: FloatArray, cloud: FloatArray, step: float, n_nodes: int) -> FloatArray:
    """Mean over the cloud of the weights of distances to a centre among nodes: (centres, n_nodes).

    Node k lies at (k - 1) step. A distance has the four weights of the cubic through the nodes around it, so that
    weights times values at the nodes interpolate what is smooth; one beyond the last nodes has none.
    """
    shares = np.zeros((len(centres), n_nodes))
    n = len(cloud)
    x, y, z = cloud[:, 0].copy(), cloud[:, 1].copy(), cloud[:, 2].copy()
    places = np.empty(n)
    # Two sums take turns, so that equal distances one after another need not wait for each other.
    halves = np.empty((2, n_nodes))
    for i in range(len(centres)):
        cx, cy, cz = centres[i, 0], centres[i, 1], centres[i, 2]
        for p in range(n):
            dx, dy, dz = cx - x[p], cy - y[p], cz - z[p]
            places[p] = np.sqrt(dx * dx + dy * dy + dz * dz) / step
        halves[:] = 0.0
        for p in range(n):
            if places[p] >= n_nodes - 3:
                continue
            share = halves[p & 1]
            node = np.uint64(places[p])
            t = places[p] - node
            u, v, w = t + 1.0, t - 1.0, t - 2.0
            outer, inner = t * v * (1.0 / 6.0), u * w * 0.5
            share[node] -= outer * w
            share[node + np.uint64(1)] += inner * v
            share[node + np.uint64(2)] -= inner * t
            share[node + np.uint64(3)] += outer * u
        for k in range(n_nodes):
            shares[i, k] = (halves[0, k] + halves[1, k]) / n
    return shares
