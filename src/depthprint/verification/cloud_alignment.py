"""Alignment of two views in space by small_gicp."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import MissingExtraError
from depthprint.verification.depth_view import DepthView

__all__ = ["CloudAligner"]

FloatArray = npt.NDArray[np.float64]

_NEIGHBOURS = 10
_ITERATIONS = 15


class CloudAligner:
    """Generalised ICP between views; the prepared clouds of the last ``kept`` views are kept.

    Source: Koide, small_gicp, JOSS 2024. Raises MissingExtraError without that package.
    """

    def __init__(self, kept: int = 256) -> None:
        try:
            import small_gicp
        except ImportError as error:
            raise MissingExtraError(
                "geometric verification: the small_gicp package is missing; pip install 'depthprint[slam]'"
            ) from error
        self._gicp = small_gicp
        self._kept = kept
        self._clouds: OrderedDict[DepthView, tuple[Any, Any]] = OrderedDict()

    def refine(self, query: DepthView, match: DepthView, T_match_query: FloatArray) -> FloatArray:
        """Refine a pose T_match_query (4, 4); one that comes out not finite is given back as it was."""
        source, _ = self._prepared(query)
        target, tree = self._prepared(match)
        result = self._gicp.align(
            target,
            source,
            tree,
            np.ascontiguousarray(T_match_query, dtype=np.float64),
            registration_type="GICP",
            max_correspondence_distance=match.settings.max_pairing_m,
            num_threads=1,
            max_iterations=_ITERATIONS,
        )
        refined = np.array(result.T_target_source, dtype=np.float64)
        return refined if np.isfinite(refined).all() else T_match_query

    def _prepared(self, view: DepthView) -> tuple[Any, Any]:
        found = self._clouds.pop(view, None)
        if found is None:
            found = self._gicp.preprocess_points(
                view.points.astype(np.float64), view.settings.voxel_m, _NEIGHBOURS, 1
            )
            if len(self._clouds) >= self._kept:
                self._clouds.popitem(last=False)
        self._clouds[view] = found
        return found
