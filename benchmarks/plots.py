"""Growth of a query with the number of places, as a picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from depthprint.io.atomic import atomic_path

__all__ = ["plot_scaling"]


def plot_scaling(scaling: Mapping[str, Any], path: Path) -> None:
    """Median time and memory over the number of places, both axes logarithmic."""
    from matplotlib.figure import Figure

    points = scaling["points"]
    places = np.array([point["places"] for point in points], dtype=float)
    query_ms = 1e3 * np.array([point["query_s"] for point in points])
    slowest_ms = 1e3 * np.array([point["slowest_query_s"] for point in points])
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    time_axes, share_axes = figure.subplots(1, 2)
    time_axes.fill_between(places, query_ms, slowest_ms, color="tab:blue", alpha=0.15, linewidth=0)
    time_axes.plot(places, query_ms, "o-", color="tab:blue", label="measured, up to the slowest")
    time_axes.plot(places, query_ms[0] * places / places[0], ":", color="grey", label="growth in proportion")
    time_axes.set(xscale="log", yscale="log", xlabel="places", ylabel="ms a query")
    time_axes.set_title(f"exact nearest place, exponent {scaling['exponent']:.2f}")
    time_axes.legend(frameon=False)
    shares = 100 * np.array([point["share_of_emds_solved"] for point in points])
    share_axes.plot(places, shares, "o-", color="tab:orange")
    share_axes.set(xscale="log", yscale="log", xlabel="places", ylabel="% of EMDs solved")
    share_axes.set_title("simulated street signatures")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=110)
