"""Which category was taken for which."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.visualization._style import SHARE_MAP, drawing, titled

__all__ = ["draw_confusion_matrix"]


def draw_confusion_matrix(
    counts: npt.NDArray[np.int64],
    labels: Sequence[str],
    path: Path | str,
    *,
    method: str = "",
    data: str = "",
    simulated: bool = False,
) -> Path:
    """Draw counts (c, c), true category down and predicted across, as shares of each true category.

    Up to 12 categories get their shares as numbers. Returns the path written. Raises DataError for other
    shapes.
    """
    counts = np.asarray(counts)
    c = len(labels)
    if c < 1 or counts.shape != (c, c) or (counts < 0).any():
        raise DataError(f"confusion matrix: expected counts ({c}, {c}) >= 0, got shape {counts.shape}")
    total = counts.sum(axis=1, keepdims=True)
    shares = np.divide(counts, total, out=np.zeros((c, c)), where=total > 0)
    accuracy = float(np.diag(shares)[total[:, 0] > 0].mean()) if total.any() else float("nan")
    side_in = float(np.clip(2.5 + 0.16 * c, 5.0, 14.0))
    with drawing(path, side_in + 1.2, side_in + 0.4) as figure:
        axes = figure.add_subplot()
        drawn = axes.imshow(shares, cmap=SHARE_MAP, vmin=0, vmax=1)
        figure.colorbar(drawn, ax=axes, label="share of the category's views", shrink=0.8)
        size = 11 if c <= 15 else 8
        axes.set_xticks(range(c), labels, rotation=90, fontsize=size)
        axes.set_yticks(range(c), labels, fontsize=size)
        axes.set(xlabel="predicted", ylabel="true")
        for row, column in np.argwhere(shares > 0) if c <= 12 else ():
            share = shares[row, column]
            ink = "white" if share > 0.6 else "black"
            axes.text(column, row, f"{share:.2f}", ha="center", va="center", color=ink, fontsize=9)
        what = f"Categories{', ' + method if method else ''}: {accuracy:.1%} right, averaged by category"
        axes.set_title(titled(what, data, simulated))
    return Path(path)
