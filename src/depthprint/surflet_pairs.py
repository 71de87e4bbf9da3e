"""Surflet pairs: the shape of a surface by its pairs of points, whatever way it is turned."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint.errors import SettingsError
from depthprint.range_image import RangeImage

if TYPE_CHECKING:
    from depthprint._kernels.surface_alignment import SeenSurface

__all__ = ["N_PAIR_FEATURES", "PAIR_CHANNELS", "image_pairs", "pair_features", "pair_vectors", "pair_view"]

Float32Array = npt.NDArray[np.float32]
Progress = Callable[[int, int], None]

# Ends of the scale of lengths: in metres, and in sizes of the object (root mean square distance from its middle).
_METRES = (0.005, 0.4)
_SIZES = (0.06, 4.0)
N_PAIR_FEATURES = 2 * 3 * 10 * 15 * 3
PAIR_CHANNELS = ("metres", "sizes")


def pair_features(surface: SeenSurface) -> Float32Array:
    """Unit vector (N_PAIR_FEATURES,) of the pairs of a surface's points.

    Roots of two histograms: of how far apart two points are in metres, or in sizes of the object, with the angles
    between their normals and the line between them, that between the normals, and whether halfway between them is
    behind the surface seen, before it, or beside it. Mirror images have the same vector.
    Source: Wahl, Hillenbrand and Hirzinger, 3DIM 2003 (surflet pairs); halfway points in the manner of Wohlkinger and
    Vincze, ROBIO 2011 (ensemble of shape functions).
    """
    from depthprint._kernels.surflet_pairs import pair_histograms

    shortest, longest = (
        np.array([metres, sizes * surface.size]) for metres, sizes in zip(_METRES, _SIZES, strict=True)
    )
    counts = pair_histograms(surface, shortest, longest)
    return np.asarray(np.sqrt(counts / max(float(counts.sum()), 1.0)).ravel(), dtype=np.float32)


@lru_cache(maxsize=4)
def image_pairs(image: RangeImage) -> Float32Array:
    """``pair_features`` of a pinhole crop in metres, read-only; those of the last few crops are kept.

    Raises as ``object_surface`` does.
    """
    from depthprint.object_surface import object_surface

    pairs = pair_features(object_surface(image))
    pairs.setflags(write=False)
    return pairs


def pair_view(image: RangeImage, channels: Sequence[str]) -> Float32Array:
    """The same as pictures (len(channels), h, 10), of PAIR_CHANNELS: a column holds the pairs of one length.

    The squares of each picture add up to 1. Raises SettingsError for an unknown channel, else as ``object_surface``.
    """
    from depthprint._kernels.surflet_pairs import N_HALFWAY, N_LENGTHS

    unknown = [name for name in channels if name not in PAIR_CHANNELS]
    if unknown:
        raise SettingsError(
            f"view 'pairs': expected channels of {', '.join(PAIR_CHANNELS)}, got {unknown[0]!r}"
        )
    pairs = image_pairs(image).reshape(len(PAIR_CHANNELS), N_HALFWAY, N_LENGTHS, -1)
    pictures = pairs.transpose(0, 1, 3, 2).reshape(len(PAIR_CHANNELS), -1, N_LENGTHS)
    chosen = pictures[[PAIR_CHANNELS.index(name) for name in channels]]
    return np.ascontiguousarray(chosen * np.float32(2.0**0.5))


def pair_vectors(images: Sequence[RangeImage], progress: Progress | None = None) -> Float32Array:
    """Vectors (n, N_PAIR_FEATURES) of pinhole crops in metres; raises as ``object_surface`` does."""
    from depthprint._kernels.blocks import for_blocks

    rows = np.empty((len(images), N_PAIR_FEATURES), dtype=np.float32)

    def block(start: int, stop: int) -> None:
        for number in range(start, stop):
            rows[number] = image_pairs(images[number])

    for_blocks(len(images), 8, block, progress)
    return rows
