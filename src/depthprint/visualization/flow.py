"""The optimal flow between two signatures, drawn on the images that they describe."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.visualization._style import BAD_COLOR, COLORS, drawing, titled

__all__ = ["PlacedClusters", "draw_flow"]

FloatArray = npt.NDArray[np.float64]

_GAP = 0.25
_STACKED_WIDTH, _STACKED_GAP = 3.0, 0.5
_LEAST_SHARE = 0.005


@dataclass(frozen=True)
class PlacedClusters:
    """One side of a flow.

    picture: (h, w), NaN where unknown; positions_px: (k, 2) column and row; weights: (k,) >= 0.
    """

    picture: FloatArray
    positions_px: FloatArray
    weights: FloatArray
    title: str = ""

    def __post_init__(self) -> None:
        picture, positions = (
            np.asarray(self.picture, float),
            np.asarray(self.positions_px, float).reshape(-1, 2),
        )
        weights = np.asarray(self.weights, float)
        if picture.ndim != 2 or not picture.size or weights.shape != (len(positions),):
            raise DataError(
                "PlacedClusters: expected a picture (h, w), positions (k, 2) and weights (k,), got shapes "
                f"{picture.shape}, {positions.shape} and {weights.shape}"
            )
        if not (np.isfinite(positions).all() and np.isfinite(weights).all()) or (weights < 0).any():
            raise DataError("PlacedClusters: expected finite positions and finite weights >= 0")
        for name, array in (("picture", picture), ("positions_px", positions), ("weights", weights)):
            object.__setattr__(self, name, array)


def draw_flow(
    first: PlacedClusters,
    second: PlacedClusters,
    flow: FloatArray,
    path: Path | str,
    *,
    costs: FloatArray | None = None,
    what: str = "",
    data: str = "",
    simulated: bool = False,
) -> Path:
    """Draw the flow (k, l) as arrows from the clusters of the first image to those of the second.

    The images stand side by side; where all clusters lie on one row each, as the columns of a bird's-eye view do,
    one stands above the other, with the clusters on the edges that face. The wider an arrow the more it moves;
    with ``costs`` (k, l) its colour is the ground distance. The area of a disc is its cluster's weight; what no
    arrow takes or brings is with the null element and is the empty part of the disc. Moves under half a percent
    of the largest are left out. Returns the path written.
    Raises DataError for flows of another shape, negative, or above the weights.
    """
    flow = _checked_flow(first, second, flow, costs)
    stacked = _on_one_row(first) and _on_one_row(second)
    boxes = _stacked_boxes() if stacked else _beside_boxes(first, second)
    with drawing(path, 9.0, 6.4 if stacked else 4.6) as figure:
        axes = figure.add_subplot()
        scale = max(first.weights.max(initial=0), second.weights.max(initial=0)) or 1.0
        places = [_inside(side, box) for side, box in zip((first, second), boxes, strict=True)]
        if stacked:
            places[0][:, 1], places[1][:, 1] = boxes[0].bottom, boxes[1].top
        for side, box, at, moved in zip(
            (first, second), boxes, places, (flow.sum(axis=1), flow.sum(axis=0)), strict=True
        ):
            _draw_picture(axes, side, box, title_beside=stacked)
            _draw_clusters(axes, at, side.weights, moved, scale)
        _draw_arrows(figure, axes, places[0], places[1], flow, costs, bend=0.0 if stacked else -0.08)
        axes.set_axis_off()
        axes.set_aspect("equal")
        axes.autoscale_view()
        moved = flow.sum() / max(first.weights.sum(), second.weights.sum(), 1e-300)
        note = f"{what}, " if what else ""
        axes.set_title(titled(f"Mass flow: {note}{moved:.0%} of the mass moved", data, simulated))
    return Path(path)


def _checked_flow(first: PlacedClusters, second: PlacedClusters, flow: Any, costs: Any) -> FloatArray:
    flow = np.array(flow, dtype=np.float64)
    shape = (len(first.weights), len(second.weights))
    if flow.shape != shape or (costs is not None and np.shape(costs) != shape):
        raise DataError(
            f"flow: expected a flow and costs of shape {shape}, got {flow.shape} and {np.shape(costs)}"
        )
    slack = 1e-6 * max(1.0, first.weights.sum(), second.weights.sum())
    taken, brought = flow.sum(axis=1), flow.sum(axis=0)
    over = (taken > first.weights + slack).any() or (brought > second.weights + slack).any()
    if not np.isfinite(flow).all() or (flow < -slack).any() or over:
        raise DataError("flow: expected finite moves >= 0 that add up to no more than the weights")
    return np.asarray(np.maximum(flow, 0.0))


class _Box(NamedTuple):
    """Where an image is drawn, in units of the figure."""

    left: float
    right: float
    bottom: float
    top: float


def _on_one_row(side: PlacedClusters) -> bool:
    return len(side.weights) > 1 and bool(np.ptp(side.positions_px[:, 1]) < 1e-6)


def _beside_boxes(first: PlacedClusters, second: PlacedClusters) -> tuple[_Box, _Box]:
    widths = [side.picture.shape[1] / side.picture.shape[0] for side in (first, second)]
    left = widths[0] + _GAP
    return _Box(0.0, widths[0], 0.0, 1.0), _Box(left, left + widths[1], 0.0, 1.0)


def _stacked_boxes() -> tuple[_Box, _Box]:
    return _Box(0.0, _STACKED_WIDTH, 1.0 + _STACKED_GAP, 2.0 + _STACKED_GAP), _Box(
        0.0, _STACKED_WIDTH, 0.0, 1.0
    )


def _inside(side: PlacedClusters, box: _Box) -> FloatArray:
    """Where the clusters of an image are when it is drawn into a box."""
    share = (side.positions_px + 0.5) / (side.picture.shape[1], side.picture.shape[0])
    at = np.stack(
        [
            box.left + share[:, 0] * (box.right - box.left),
            box.top - share[:, 1] * (box.top - box.bottom),
        ],
        axis=1,
    )
    return np.asarray(at)


def _draw_picture(axes: Any, side: PlacedClusters, box: _Box, *, title_beside: bool) -> None:
    from matplotlib import colormaps

    known = side.picture[np.isfinite(side.picture)]
    low, high = np.percentile(known, [1, 99]) if known.size else (0.0, 1.0)
    colors = colormaps["gray_r"].with_extremes(bad=BAD_COLOR)
    # twice the span keeps the picture pale, so that discs and arrows stand out
    axes.imshow(side.picture, cmap=colors, vmin=low, vmax=high + (high - low), extent=box)
    if title_beside:
        middle = (box.bottom + box.top) / 2
        axes.text(box.left - 0.04, middle, side.title, ha="right", va="center", rotation=90)
    else:
        axes.text((box.left + box.right) / 2, box.bottom - 0.04, side.title, ha="center", va="top")


def _draw_clusters(axes: Any, at: FloatArray, weights: FloatArray, moved: FloatArray, scale: float) -> None:
    area = 420.0 / scale
    axes.scatter(*at.T, s=area * weights, facecolor="white", edgecolor="black", lw=1.0, zorder=6)
    axes.scatter(*at.T, s=area * np.minimum(moved, weights), color=COLORS[0], lw=0, zorder=7)


def _draw_arrows(
    figure: Any,
    axes: Any,
    first_at: FloatArray,
    second_at: FloatArray,
    flow: FloatArray,
    costs: FloatArray | None,
    *,
    bend: float,
) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.patches import FancyArrowPatch

    largest = flow.max(initial=0.0)
    if largest <= 0:
        return
    shown = np.argwhere(flow >= _LEAST_SHARE * largest)
    colors = ScalarMappable(cmap=colormaps["plasma"])
    if costs is not None:
        colors.set_norm(Normalize(0.0, max(float(np.max(np.asarray(costs)[tuple(shown.T)])), 1e-9)))
        figure.colorbar(colors, ax=axes, label="ground distance", shrink=0.75)
    for i, j in shown:
        axes.add_patch(
            FancyArrowPatch(
                first_at[i],
                second_at[j],
                arrowstyle="-|>",
                mutation_scale=10,
                connectionstyle=f"arc3,rad={bend}",
                lw=0.4 + 4.0 * flow[i, j] / largest,
                color=COLORS[1] if costs is None else colors.to_rgba(np.asarray(costs)[i, j]),
                alpha=0.75,
                zorder=5,
            )
        )
