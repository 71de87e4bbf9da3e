"""Camera images as grey values, for stereo matching."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.io._files import read_bytes
from depthprint.io._png import _check_chunks

__all__ = ["read_grey_image"]


def read_grey_image(path: Path | str) -> npt.NDArray[np.uint8]:
    """(height, width) uint8 of an 8-bit PNG, colour turned to grey; DataError naming any other file."""
    path = Path(path)
    content = read_bytes(path)
    expected = f"{path}: expected an 8-bit PNG image"
    if not content.startswith(b"\x89PNG\r\n\x1a\n"):
        raise DataError(f"{expected}, got a file without the PNG signature")
    bit_depth, _ = _check_chunks(content, expected)
    if bit_depth != 8:
        raise DataError(f"{expected}, got one of {bit_depth} bits")
    import cv2

    try:
        pixels = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error as error:
        raise DataError(f"{expected}, got one that cannot be decoded ({error})") from error
    if pixels is None:
        raise DataError(f"{expected}, got one that cannot be decoded")
    return np.asarray(pixels, dtype=np.uint8)
