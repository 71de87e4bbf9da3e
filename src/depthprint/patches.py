"""Patches of a view: the vectors that are coded, with their positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import SettingsError
from depthprint.settings import StreamSettings
from depthprint.views import View

__all__ = ["Patches", "extract_patches"]


@dataclass(frozen=True)
class Patches:
    """Vectors to code and where they were taken.

    vectors: (m, c * ph * pw) float32. A vector without support is zero.
    positions: (m, p) float64 in [0, 1]: x of the patch centre, then y where the grid has more than one row.
    depth: (m,) float64 mean relative depth on the support.
    centres_px: (m, 2) float64 centre (x, y) on the view's grid, for figures.
    """

    vectors: npt.NDArray[np.float32]
    positions: npt.NDArray[np.float64]
    depth: npt.NDArray[np.float64]
    centres_px: npt.NDArray[np.float64]


def extract_patches(view: View, stream: StreamSettings, wraps: bool = False) -> Patches:
    """Cut a view into overlapping patches, row by row; with ``wraps`` they continue round the right edge.

    Image atoms take the whole view as one patch. Raises SettingsError when the patch is larger than the view.
    """
    channels, support = view.channels, view.support
    _, height, width = channels.shape
    ph, pw = (height, width) if stream.atoms == "image" else stream.patch_shape
    ph, pw = ph or height, pw or width
    if ph > height or pw > width:
        raise SettingsError(f"patch_shape: {ph} x {pw} does not fit a view of {height} x {width}")
    depth = view.depth if view.depth is not None else np.zeros((height, width), dtype=np.float32)
    if wraps:
        channels, support, depth = (
            np.concatenate([a, a[..., : pw - 1]], axis=-1) for a in (channels, support, depth)
        )
    step = 1 if stream.atoms == "image" else stream.stride
    from depthprint._kernels.patch_cutting import cut_patches

    vectors, share, mean_depth = cut_patches(
        np.ascontiguousarray(channels),
        np.ascontiguousarray(support),
        np.ascontiguousarray(depth),
        ph,
        pw,
        step,
    )
    rows, columns = (support.shape[0] - ph) // step + 1, (support.shape[1] - pw) // step + 1
    if stream.centre:
        vectors -= vectors.mean(2, keepdims=True)
        vectors[share == 0] = 0.0
    x = np.arange(columns) * step + pw / 2
    y = np.arange(rows) * step + ph / 2
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    positions = centres / (width, height)
    if rows == 1:
        positions = positions[:, :1]
    return Patches(vectors.reshape(rows * columns, -1), positions, mean_depth, centres)
