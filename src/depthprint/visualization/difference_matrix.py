"""Distances of all pairs of frames (paper, before Fig. 6)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.visualization._style import BAD_COLOR, drawing, titled

__all__ = ["draw_difference_matrix"]


def draw_difference_matrix(
    distances: npt.NDArray[np.floating],
    path: Path | str,
    *,
    method: str = "",
    data: str = "",
    simulated: bool = False,
    label: str = "distance",
    frames: tuple[int, int] | None = None,
) -> Path:
    """Draw (n, m) distances, query down and match across; NaN (not compared) is grey, near is dark.

    Loops show as dark lines beside the diagonal. The colours span the 1st to the 99th percentile.
    frames: the first and the last frame, of rows and columns alike, where not every frame has its own.
    Returns the path written. Raises DataError where nothing is finite.
    """
    matrix = np.asarray(distances)
    if matrix.ndim != 2:
        raise DataError(f"difference matrix: expected two dimensions, got shape {matrix.shape}")
    known = matrix[np.isfinite(matrix)]
    if not known.size:
        raise DataError("difference matrix: expected at least one finite distance, got none")
    from matplotlib import colormaps

    low, high = np.percentile(known, [1, 99])
    with drawing(path, 7.0, 6.2) as figure:
        axes = figure.add_subplot()
        colors = colormaps["viridis"].with_extremes(bad=BAD_COLOR)
        drawn = axes.imshow(matrix, cmap=colors, vmin=low, vmax=high, extent=_extent(matrix.shape, frames))
        figure.colorbar(drawn, ax=axes, label=label, extend="both", shrink=0.85)
        axes.set(xlabel="match (frame)", ylabel="query (frame)")
        axes.set_title(titled(f"Distance of all pairs{', ' + method if method else ''}", data, simulated))
    return Path(path)


def _extent(
    shape: tuple[int, ...], frames: tuple[int, int] | None
) -> tuple[float, float, float, float] | None:
    """Left, right, bottom and top of the picture in frames, whose middle a pixel's is."""
    if frames is None:
        return None
    first, last = frames
    across, down = (0.5 * (last - first) / max(n - 1, 1) for n in (shape[1], shape[0]))
    return first - across, last + across, last + down, first - down
