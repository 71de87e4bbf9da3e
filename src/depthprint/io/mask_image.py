"""Masks of objects: grey PNG of one to eight bits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.io._png import read_grey_png
from depthprint.io.atomic import atomic_path

__all__ = ["read_mask_image", "write_mask_image"]


def read_mask_image(path: Path | str) -> npt.NDArray[np.bool_]:
    """(height, width) bool, true where a grey PNG is not zero; DataError naming any other file."""
    mask: npt.NDArray[np.bool_] = read_grey_png(Path(path), (1, 2, 4, 8)) > 0
    return mask


def write_mask_image(path: Path | str, mask: npt.ArrayLike) -> None:
    """Write a (height, width) bool mask as an 8-bit PNG of 0 and 255."""
    array = np.asarray(mask)
    if array.ndim != 2 or array.size == 0 or array.dtype != np.bool_:
        raise DataError(f"{path}: expected a bool mask (height, width), got {array.dtype} {array.shape}")
    import cv2

    done, encoded = cv2.imencode(".png", array.astype(np.uint8) * 255)
    if not done:
        raise DataError(f"{path}: a mask of shape {array.shape} cannot be written as PNG")
    with atomic_path(path) as temporary:
        temporary.write_bytes(encoded.tobytes())
