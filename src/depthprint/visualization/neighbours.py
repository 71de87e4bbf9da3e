"""Queries with the stored views nearest to them, as pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from depthprint.errors import DataError
from depthprint.range_image import RangeImage
from depthprint.visualization._style import BAD_COLOR, COLORS, DEPTH_MAP, drawing, titled

__all__ = ["NeighbourRow", "draw_neighbours"]


@dataclass(frozen=True)
class NeighbourRow:
    """A query and the views nearest to it, nearest first: images, and the label of each."""

    images: tuple[RangeImage, ...]
    labels: tuple[str, ...]


def draw_neighbours(
    rows: Sequence[NeighbourRow],
    path: Path | str,
    *,
    method: str = "",
    data: str = "",
    simulated: bool = False,
) -> Path:
    """Draw one query a row, then its nearest views; a frame tells whether a view is of the query's label.

    Depth inside the mask only, each picture in its own range. Returns the path written. Raises DataError without rows,
    or for rows of unequal length.
    """
    widths = {len(row.images) for row in rows} | {len(row.labels) for row in rows}
    if len(widths) != 1 or min(widths) < 2:
        raise DataError("neighbours: expected rows of a query and as many nearest views and labels in each")
    columns = widths.pop()
    with drawing(path, 1.7 * columns, 1.75 * len(rows) + 0.8) as figure:
        grid = figure.subplots(len(rows), columns, squeeze=False)
        for line, row in zip(grid, rows, strict=True):
            for axes, image, label in zip(line, row.images, row.labels, strict=True):
                _draw_view(axes, image)
                axes.set_title(label, fontsize=9)
            for axes, label in zip(line[1:], row.labels[1:], strict=True):
                same = label == row.labels[0]
                for spine in axes.spines.values():
                    spine.set(visible=True, color=COLORS[2] if same else COLORS[1], linewidth=3)
            line[0].set_ylabel("query", fontsize=9)
        what = (
            f"Nearest views{', ' + method if method else ''}: green of the same category, orange of another"
        )
        figure.suptitle(titled(what, data, simulated))
    return Path(path)


def _draw_view(axes: Any, image: RangeImage) -> None:
    from matplotlib import colormaps

    shown = np.array(image.ranges_m)
    if image.mask is not None:
        shown[~image.mask] = np.nan
    axes.imshow(shown, cmap=colormaps[DEPTH_MAP].with_extremes(bad=BAD_COLOR))
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
