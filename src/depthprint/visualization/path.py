"""The travelled path with the loops found on it (paper Fig. 5)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.evaluation.loops import MethodLoops
from depthprint.visualization._style import COLORS, drawing, titled

__all__ = ["PathLoops", "draw_path"]

_TRUE, _FALSE, _MISSED, _UNJUDGED = COLORS[2], COLORS[1], COLORS[4], COLORS[0]


@dataclass(frozen=True)
class PathLoops:
    """Loops by what became of them; pairs (m, 2) of query and match, ``missed`` (m,) queries.

    unjudged: detections that the truth ignores, or all of them where there is no truth.
    """

    true: npt.NDArray[np.int64]
    false: npt.NDArray[np.int64]
    missed: npt.NDArray[np.int64]
    unjudged: npt.NDArray[np.int64]

    @classmethod
    def at_threshold(cls, method: MethodLoops, max_distance: float) -> PathLoops:
        """Sort a method's queries by what they are when distances up to ``max_distance`` are detections."""
        detected = [r for r in method.records if r.match >= 0 and r.distance <= max_distance]
        by_outcome = {
            outcome: np.array([(r.query, r.match) for r in detected if r.outcome == outcome], dtype=np.int64)
            for outcome in (1, -1, 0)
        }
        found = {r.query for r in detected if r.outcome == 1}
        missed = [r.query for r in method.records if r.has_positive and r.query not in found]
        true, false, unjudged = (by_outcome[outcome].reshape(-1, 2) for outcome in (1, -1, 0))
        return cls(true, false, np.array(missed, dtype=np.int64), unjudged)

    @classmethod
    def without_truth(cls, detections: npt.NDArray[np.int64]) -> PathLoops:
        """Detections (m, 2) that nobody judged."""
        none = np.empty((0, 2), dtype=np.int64)
        return cls(none, none, none[:, 0], np.asarray(detections, dtype=np.int64).reshape(-1, 2))


def draw_path(
    positions_m: npt.NDArray[np.float64],
    loops: PathLoops,
    path: Path | str,
    *,
    method: str = "",
    data: str = "",
    simulated: bool = False,
) -> Path:
    """Draw the path (n, 2), metres, from above, with true, false (joined to their match) and missed loops.

    Returns the path written. Raises DataError for positions that are not finite or loops beyond them.
    """
    positions_m = np.asarray(positions_m, dtype=np.float64)
    if positions_m.ndim != 2 or positions_m.shape[1] != 2 or not np.isfinite(positions_m).all():
        raise DataError(f"path: expected finite positions (n, 2), got shape {positions_m.shape}")
    for frames in (loops.true, loops.false, loops.missed, loops.unjudged):
        if frames.size and not 0 <= frames.min() <= frames.max() < len(positions_m):
            raise DataError(f"path: expected loops among {len(positions_m)} frames, got frame {frames.max()}")
    wide, tall = np.ptp(positions_m, axis=0) + 1e-9
    height_in = float(np.clip(6.5 * tall / wide, 3.0, 7.5)) + 1.2
    with drawing(path, 7.5, height_in) as figure:
        axes = figure.add_subplot()
        axes.plot(*positions_m.T, color="0.75", lw=1.5, zorder=1)
        axes.plot(*positions_m[0], "s", ms=6, color="black", zorder=6, label="start")
        _mark(axes, positions_m, loops.missed, _MISSED, "missed", zorder=3)
        _mark(axes, positions_m, loops.unjudged[:, 0], _UNJUDGED, "detected, not judged", zorder=2)
        _mark(axes, positions_m, loops.true[:, 0], _TRUE, "true", zorder=4)
        _mark(axes, positions_m, loops.false[:, 0], _FALSE, "false", zorder=5)
        if len(loops.false):
            from matplotlib.collections import LineCollection

            axes.add_collection(
                LineCollection(list(positions_m[loops.false]), colors=_FALSE, lw=0.8, alpha=0.6, zorder=4)
            )
        axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
        axes.grid(color="0.93")
        axes.set_axisbelow(True)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=10, markerscale=1.6)
        axes.set_title(titled(f"Travelled path and loops{', ' + method if method else ''}", data, simulated))
    return Path(path)


def _mark(
    axes: Any,
    positions_m: npt.NDArray[np.float64],
    frames: npt.NDArray[np.int64],
    color: str,
    label: str,
    zorder: int,
) -> None:
    if len(frames):
        at = positions_m[frames]
        axes.plot(*at.T, "o", ms=4, color=color, mec="none", zorder=zorder, label=f"{label} ({len(frames)})")
