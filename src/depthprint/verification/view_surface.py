"""ViewSurface: points and normals of the pixels of a view that weights and alignment ask for, worked out once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint.verification.surface import pixels_of, surface_at
from depthprint.verification.surface_weights import surface_weights

if TYPE_CHECKING:
    from depthprint.verification.depth_view import DepthView

__all__ = ["ViewSurface", "surface_of"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# Points of those that are counted, and of all: the ground among these holds height, roll and pitch.
# A hand-held view has no ground to lean on, and is tried on more.
_QUICK, _QUICK_HAND_HELD, _FINE = (250, 125), (400, 200), (1200, 1000)
# Surfaces of the last views are kept: each is large, and no view is looked at for long.
_KEPT = 8


@dataclass(frozen=True, eq=False)
class ViewSurface:
    """The surface that a view shows, at pixels that were drawn of it.

    counted: (m,) pixel of each counted point. seen: (k,) pixels with a return. points, normals: (n, 3) float64 at the
    drawn pixels, normal 0 where unknown. row_of: (h * w,) row in them of each drawn pixel.
    """

    view: DepthView
    counted: IntArray
    seen: IntArray
    points: FloatArray
    normals: FloatArray
    row_of: IntArray

    @property
    def weights(self) -> npt.NDArray[np.float32]:
        """(m,) float32 of the counted points, as `surface_weights` gives them."""
        rows = self.row_of[self.counted]
        view = self.view
        return surface_weights(view.counted, self.points[rows], self.normals[rows], view.projection)

    @cached_property
    def quick(self) -> tuple[FloatArray, FloatArray]:
        """Points and normals (n, 3), evenly of the counted pixels and of all, few of them."""
        return self._sample(*_few(self.view))

    @cached_property
    def fine(self) -> tuple[FloatArray, FloatArray]:
        """As ``quick``, several times as many."""
        return self._sample(*_FINE)

    def _sample(self, n_counted: int, n_of_all: int) -> tuple[FloatArray, FloatArray]:
        pixels = _united(self.view, _drawn(self.counted, n_counted), _drawn(self.seen, n_of_all))
        rows = self.row_of[pixels]
        rows = rows[self.normals[rows].any(axis=1)]
        return self.points[rows], self.normals[rows]


@lru_cache(maxsize=_KEPT)
def surface_of(view: DepthView) -> ViewSurface:
    """The surface of a view; that of the last few views is kept."""
    counted = pixels_of(view.counted, view.ranges_m, view.projection)
    seen = np.flatnonzero(np.isfinite(view.ranges_m))
    drawn = [_drawn(seen, n_of_all) for _, n_of_all in (_few(view), _FINE)]
    pixels = _united(view, counted, *drawn)
    points, normals = surface_at(pixels, view.ranges_m, view.projection)
    row_of: IntArray = np.full(view.ranges_m.size, -1, dtype=np.int64)
    row_of[pixels] = np.arange(len(pixels))
    return ViewSurface(view, counted, seen, points, normals, row_of)


def _few(view: DepthView) -> tuple[int, int]:
    return _QUICK_HAND_HELD if view.settings.whole_clouds else _QUICK


def _united(view: DepthView, *pixels: IntArray) -> IntArray:
    """The pixels that are in any of some lists, in order."""
    wanted = np.zeros(view.ranges_m.size, dtype=bool)
    for some in pixels:
        wanted[some] = True
    return np.flatnonzero(wanted)


def _drawn(pixels: IntArray, count: int) -> IntArray:
    return pixels[np.linspace(0, len(pixels) - 1, min(len(pixels), count)).astype(np.int64)]
