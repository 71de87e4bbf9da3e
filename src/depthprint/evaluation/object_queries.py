"""Queries of the object protocols that are several views of one turn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import ObjectView
from depthprint.errors import DataError, SettingsError

__all__ = ["turn_queries"]

IndexArray = npt.NDArray[np.int64]


def turn_queries(views: Sequence[ObjectView], test: IndexArray, n_views: int) -> IndexArray:
    """Number the views of each query: ``n_views`` consecutive ones of a turn, as a moving camera has them.

    One query begins at each view of ``test``; after the last frame of a turn comes its first. Returns
    (len(test), n_views) positions within ``test``. Raises DataError when a tested turn is shorter than that.
    """
    if n_views < 1:
        raise SettingsError(f"views: expected 1 or more views a query, got {n_views}")
    turns: dict[tuple[str, int], list[int]] = {}
    for position, number in enumerate(test):
        view = views[number]
        turns.setdefault((view.instance, view.video), []).append(position)
    queries = np.empty((len(test), n_views), dtype=np.int64)
    for (instance, video), positions in turns.items():
        if len(positions) < n_views:
            raise DataError(
                f"{instance}, video {video}: expected {n_views} views or more in each turn, "
                f"got {len(positions)}"
            )
        turn = np.array(sorted(positions, key=lambda p: views[int(test[p])].frame))
        for start in range(len(turn)):
            queries[turn[start]] = turn[(start + np.arange(n_views)) % len(turn)]
    return queries
