"""Precision over recall of all methods (paper Fig. 6)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from depthprint.errors import DataError
from depthprint.evaluation.metrics import QueryOutcomes, loop_metrics, precision_recall
from depthprint.visualization._style import COLORS, drawing, titled

__all__ = ["draw_precision_recall"]

_DASHES = ("-", "--", "-.", ":")


def draw_precision_recall(
    methods: Mapping[str, QueryOutcomes], path: Path | str, *, data: str = "", simulated: bool = False
) -> Path:
    """Draw every method's curve, with its average precision and, as a dot, its recall at 100 % precision.

    Curves start at the smallest recall above zero. Returns the path written. Raises DataError where there is
    nothing to find.
    """
    if not methods:
        raise DataError("precision-recall: expected at least one method, got none")
    with drawing(path, 9.0, 5.2) as figure:
        axes = figure.add_subplot()
        for number, (name, queries) in enumerate(methods.items()):
            if not queries.has_positive.any():
                raise DataError(f"precision-recall: method {name!r} has no query with a loop to find")
            curve, metrics = precision_recall(queries), loop_metrics(queries)
            found = curve.true_positives > 0
            at_100 = metrics.recall_at_100_precision
            color, dashes = COLORS[number % len(COLORS)], _DASHES[number // len(COLORS) % len(_DASHES)]
            axes.plot(
                curve.recall[found],
                curve.precision[found],
                dashes,
                color=color,
                lw=2,
                label=f"{name}: AP {metrics.average_precision:.2f}, R@100P {at_100:.2f}",
            )
            if at_100 > 0:
                axes.plot(at_100, 1.0, "o", ms=8, color=color, mec="white", clip_on=False, zorder=3)
        axes.plot(np.nan, np.nan, "o", ms=8, color="0.5", label="recall at 100 % precision")
        axes.set(xlim=(0, 1.01), ylim=(0, 1.02), xlabel="recall", ylabel="precision")
        axes.grid(color="0.9")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=9)
        axes.set_title(titled("Loop closure: precision and recall", data, simulated))
    return Path(path)
