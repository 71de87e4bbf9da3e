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
_RIGHT, _WRONG = COLORS[2], COLORS[6]


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
    """Draw paths (n, 2), metres: odometry on the left, corrected on the right, both over the true one; errors below.

    loops: (m, 2) frames that loops join, drawn on the odometry; right: (m,) whether each joins places that are one.
    errors_m: absolute error of 'odometry' and 'corrected', for the titles. Returns the path written. Raises DataError
    for paths of other shapes, loops beyond them, and missing errors.
    """
    paths = [np.asarray(p, dtype=np.float64) for p in (true_m, drifted_m, corrected_m)]
    if any(p.shape != paths[0].shape or p.ndim != 2 or p.shape[1] != 2 for p in paths):
        raise DataError(f"trajectories: expected three paths (n, 2), got {[p.shape for p in paths]}")
    loops, right = np.asarray(loops, dtype=np.int64).reshape(-1, 2), np.asarray(right, dtype=np.bool_)
    if len(right) != len(loops) or (loops.size and not 0 <= loops.min() <= loops.max() < len(paths[0])):
        raise DataError(
            f"trajectories: expected loops (m, 2) among {len(paths[0])} frames, and whether each is right"
        )
    if not {"odometry", "corrected"} <= errors_m.keys():
        raise DataError(f"trajectories: expected errors of odometry and corrected, got {sorted(errors_m)}")
    true, drifted, corrected = paths
    frames = np.arange(len(true))
    with drawing(path, 12.0, 8.2) as figure:
        grid = figure.add_gridspec(2, 2, height_ratios=[3.2, 1.0])
        left = figure.add_subplot(grid[0, 0])
        _draw_path(left, true, drifted, "odometry", _DRIFTED)
        _draw_loops(left, drifted, loops, right)
        left.set_title(f"Odometry alone: off by {errors_m['odometry']:.2f} m (ATE RMSE)")
        middle = figure.add_subplot(grid[0, 1], sharex=left, sharey=left)
        _draw_path(middle, true, corrected, "with loops", _CORRECTED)
        _draw_loops(middle, corrected, loops, right)
        middle.set_title(f"With {len(loops)} loops closed: off by {errors_m['corrected']:.2f} m")
        below = figure.add_subplot(grid[1, :])
        for positions, label, color in (
            (drifted, "odometry", _DRIFTED),
            (corrected, "with loops", _CORRECTED),
        ):
            below.plot(frames, np.linalg.norm(positions - true, axis=1), color=color, lw=1.6, label=label)
        for _, second in loops[right].tolist():
            below.plot([second], [0], "|", color=_RIGHT, ms=7, zorder=3)
        below.set(xlabel="frame", ylabel="error of position (m)", xlim=(0, len(true) - 1))
        below.set_ylim(bottom=0)
        below.grid(color="0.93")
        below.legend(loc="upper left", ncols=2)
        figure.suptitle(titled("Loops found by depth correct the drift of odometry", data, simulated))
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

    for chosen, color, label, zorder in ((right, _RIGHT, "right loop", 2), (~right, _WRONG, "wrong loop", 5)):
        if chosen.any():
            lines = LineCollection(
                list(path[loops[chosen]]),
                colors=color,
                lw=1.0,
                alpha=0.8,
                zorder=zorder,
                label=f"{label} ({chosen.sum()})",
            )
            axes.add_collection(lines)
    axes.legend(loc="upper left", fontsize=9)
