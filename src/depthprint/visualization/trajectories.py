"""True, drifted and corrected paths seen from above, with the loops that corrected them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.visualization._style import COLORS, drawing, titled

__all__ = ["draw_trajectories"]

_TRUE_PATH, _DRIFTED, _CORRECTED = "0.6", COLORS[1], COLORS[0]
_RIGHT, _WRONG = COLORS[2], "#CC0000"


def draw_trajectories(
    true_m: npt.NDArray[np.float64],
    drifted_m: npt.NDArray[np.float64],
    corrected_m: npt.NDArray[np.float64],
    loops: npt.NDArray[np.int64],
    right: npt.NDArray[np.bool_],
    path: Path | str,
    *,
    errors_m: Mapping[str, float],
    data: str = "",
    simulated: bool = False,
) -> Path:
    """Draw paths (n, 2), metres, that start together: odometry left, corrected right, over the true one; errors below.

    loops: (m, 2) frames that loops join; right: (m,) whether each joins places that are one. errors_m: absolute
    trajectory error of 'odometry' and of 'corrected', for the titles. Returns the path written. Raises DataError for
    paths of other shapes or not finite, loops beyond them, and missing errors.
    """
    paths = [np.asarray(p, dtype=np.float64) for p in (true_m, drifted_m, corrected_m)]
    if any(p.shape != paths[0].shape or p.ndim != 2 or p.shape[1] != 2 for p in paths):
        raise DataError(f"trajectories: expected three paths (n, 2), got {[p.shape for p in paths]}")
    if not all(np.isfinite(p).all() for p in paths):
        raise DataError("trajectories: expected finite paths, got NaN or infinity")
    loops, right = np.asarray(loops, dtype=np.int64).reshape(-1, 2), np.asarray(right, dtype=np.bool_)
    if len(right) != len(loops) or (loops.size and not 0 <= loops.min() <= loops.max() < len(paths[0])):
        raise DataError(
            f"trajectories: expected loops (m, 2) among {len(paths[0])} frames, and whether each is right"
        )
    if not {"odometry", "corrected"} <= errors_m.keys():
        raise DataError(f"trajectories: expected errors of odometry and corrected, got {sorted(errors_m)}")
    true, drifted, corrected = paths
    everything = np.concatenate(paths)
    wide, tall = np.ptp(everything, axis=0) + 1e-9
    map_in = float(np.clip(5.6 * tall / wide, 2.5, 7.0))
    with drawing(path, 12.0, map_in + 3.6) as figure:
        grid = figure.add_gridspec(2, 2, height_ratios=[map_in, 1.8])
        left = figure.add_subplot(grid[0, 0])
        right_side = figure.add_subplot(grid[0, 1], sharex=left, sharey=left)
        for axes, positions, label, color in (
            (left, drifted, "odometry", _DRIFTED),
            (right_side, corrected, "corrected", _CORRECTED),
        ):
            _draw_path(axes, true, positions, label, color)
            _draw_loops(axes, positions, loops, right)
        left.set_title(f"Odometry alone: ATE RMSE {errors_m['odometry']:.2f} m")
        right_side.set_title(f"{len(loops)} loops closed: ATE RMSE {errors_m['corrected']:.2f} m")
        below = figure.add_subplot(grid[1, :])
        for positions, label, color in (
            (drifted, "odometry", _DRIFTED),
            (corrected, "corrected", _CORRECTED),
        ):
            below.plot(np.linalg.norm(positions - true, axis=1), color=color, lw=1.6, label=label)
        if len(loops):
            ends = loops.max(axis=1)
            below.plot(
                ends, np.zeros(len(ends)), "|", color=_RIGHT, ms=9, mew=1.2, label="loop closed", zorder=3
            )
        below.set(xlabel="frame", ylabel="off the true path (m)", xlim=(0, len(true) - 1))
        below.set_ylim(bottom=0)
        below.grid(color="0.93")
        below.legend(loc="upper left", ncols=3)
        figure.suptitle(titled("Loops found by depth alone take the drift out of odometry", data, simulated))
    return Path(path)


def _draw_path(
    axes: Any, true: npt.NDArray[np.float64], path: npt.NDArray[np.float64], label: str, color: str
) -> None:
    axes.plot(*true.T, color=_TRUE_PATH, lw=4.0, alpha=0.6, label="true path", zorder=1)
    axes.plot(*path.T, color=color, lw=1.4, label=label, zorder=3)
    axes.plot(*path[0], "s", ms=7, color="black", label="start", zorder=6)
    axes.plot(*path[-1], "X", ms=8, color=color, mec="white", label="end", zorder=6)
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.grid(color="0.93")
    axes.set_axisbelow(True)


def _draw_loops(
    axes: Any, path: npt.NDArray[np.float64], loops: npt.NDArray[np.int64], right: npt.NDArray[np.bool_]
) -> None:
    from matplotlib.collections import LineCollection

    for chosen, color, width, label in (
        (right, _RIGHT, 1.0, "true loop"),
        (~right, _WRONG, 2.0, "false loop"),
    ):
        if chosen.any():
            lines = LineCollection(
                list(path[loops[chosen]]), colors=color, lw=width, zorder=4, label=f"{label} ({chosen.sum()})"
            )
            axes.add_collection(lines)
    axes.legend(loc="best", fontsize=9)
