"""PNG files checked chunk by chunk before they are decoded: decoders pass over a missing end in silence."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.io._files import read_bytes

__all__ = ["read_grey_png"]

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOUR_TYPES = {0: "grey", 2: "colour", 3: "palette", 4: "grey with alpha", 6: "colour with alpha"}


def read_grey_png(path: Path, bit_depths: tuple[int, ...]) -> npt.NDArray[Any]:
    """Pixels (height, width) of a grey PNG of one of the bit depths; DataError for anything else."""
    content = read_bytes(path)
    expected = f"{path}: expected a {' or '.join(map(str, bit_depths))}-bit grey PNG"
    if not content.startswith(_SIGNATURE):
        raise DataError(f"{expected}, got a file without the PNG signature")
    depth, colour = _check_chunks(content, expected)
    if depth not in bit_depths or colour != 0:
        raise DataError(f"{expected}, got {depth}-bit {_COLOUR_TYPES.get(colour, f'colour type {colour}')}")
    import cv2

    try:
        pixels = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DataError(f"{expected}, got one that cannot be decoded ({error})") from error
    wanted = np.uint16 if depth == 16 else np.uint8
    if pixels is None or pixels.ndim != 2 or pixels.dtype != wanted:
        raise DataError(f"{expected}, got one that cannot be decoded")
    decoded: npt.NDArray[Any] = pixels
    return decoded


def _check_chunks(content: bytes, expected: str) -> tuple[int, int]:
    """Bit depth and colour type; DataError when a chunk is cut, damaged, or the end is missing."""
    at = len(_SIGNATURE)
    header: tuple[int, int] | None = None
    while True:
        if at + 12 > len(content):
            raise DataError(f"{expected}, got a truncated one ({len(content)} bytes, no end chunk)")
        length, kind = struct.unpack_from(">I4s", content, at)
        end = at + 8 + length
        if end + 4 > len(content):
            raise DataError(f"{expected}, got a truncated one ({len(content)} bytes, cut within {kind!r})")
        if zlib.crc32(memoryview(content)[at + 4 : end]) != struct.unpack_from(">I", content, end)[0]:
            raise DataError(f"{expected}, got a damaged one (checksum of {kind!r} at byte {at})")
        if header is None:
            if kind != b"IHDR" or length != 13:
                raise DataError(f"{expected}, got a damaged one (no header)")
            header = content[at + 16], content[at + 17]
        if kind == b"IEND":
            return header
        at = end + 4
