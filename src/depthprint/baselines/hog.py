"""Histograms of oriented gradients of an object's depth: the plain reference any reviewer asks for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import MissingExtraError
from depthprint.range_image import RangeImage
from depthprint.settings import EncoderSettings, StreamSettings
from depthprint.views import make_view

__all__ = ["hog_features"]

Float32Array = npt.NDArray[np.float32]
Progress = Callable[[int, int], None]

# Side, cell and smoothing are the best of nine by nested splits of training objects; so was depth rather than normals.
SIDE_PX = 48
CELL_PX = 8
ORIENTATIONS = 9
BLOCK_CELLS = 2
SMOOTHING_PX = 3.0


def hog_features(
    images: Sequence[RangeImage], progress: Progress | None = None
) -> tuple[Float32Array, Float32Array]:
    """Unit vectors (n, d) of images and of their mirror images: HOG of relative depth, 48 x 48, aspect kept.

    Depth is that of the object, nothing around it; an image without mask is taken whole. Raises MissingExtraError
    without scikit-image, DataError (naming the frame) for an image without return.
    Source: Dalal and Triggs 2005, as scikit-image has it.
    """
    hog = _library_hog()
    stream = StreamSettings(view="depth", size=2 * SIDE_PX, smoothing=SMOOTHING_PX)
    settings = EncoderSettings(name="hog", streams=(stream,))

    def row(image: RangeImage, mirror: bool) -> Float32Array:
        vector = hog(
            make_view(image, stream, settings, mirror).channels[0].astype(np.float64),
            orientations=ORIENTATIONS,
            pixels_per_cell=(CELL_PX, CELL_PX),
            cells_per_block=(BLOCK_CELLS, BLOCK_CELLS),
            block_norm="L2-Hys",
        )
        return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9), dtype=np.float32)

    pairs = []
    for number in range(len(images)):
        pairs.append((row(images[number], False), row(images[number], True)))
        if progress is not None:
            progress(number + 1, len(images))
    straight, mirrored = (np.stack(rows) for rows in zip(*pairs, strict=True))
    return straight, mirrored


def _library_hog() -> Callable[..., npt.NDArray[Any]]:
    try:
        from skimage.feature import hog
    except ImportError:
        raise MissingExtraError("hog-svm needs scikit-image: pip install 'depthprint[hog]'") from None
    found: Callable[..., npt.NDArray[Any]] = hog
    return found
