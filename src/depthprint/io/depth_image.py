"""Depth images: 16-bit PNG and PGM, NPY and NPZ; depth becomes metres, no return becomes NaN."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.io._files import read_bytes
from depthprint.io._png import read_grey_png
from depthprint.io.atomic import atomic_path

__all__ = ["DEPTH_SUFFIXES", "read_depth_image", "write_depth_npy", "write_depth_png"]

DEPTH_SUFFIXES = (".png", ".pgm", ".npy", ".npz")

_NO_RETURN_16_BIT = 65535
_NPZ_KEYS = ("ranges_m", "depth_m", "depth")


def read_depth_image(path: Path | str, scale_m: float = 0.001) -> npt.NDArray[np.float32]:
    """(height, width) float32 metres of a depth image; NaN = no return.

    16-bit PNG and PGM, and integers in NPY or NPZ, are multiplied by ``scale_m``; floating NPY and NPZ are
    metres already. 0, 65535 in 16-bit images, and what is not finite or negative are no return.
    Raises DataError naming the file when it is missing, empty, truncated, damaged, colour, or of 8 bits.
    """
    path = Path(path)
    _check_scale(scale_m)
    suffix = path.suffix.lower()
    if suffix == ".png":
        raw = read_grey_png(path, (16,))
    elif suffix == ".pgm":
        raw = _read_pgm(path)
    elif suffix in (".npy", ".npz"):
        raw = _read_numpy(path)
    else:
        raise DataError(f"{path}: expected a depth image ({', '.join(DEPTH_SUFFIXES)}), got {suffix!r}")
    return _to_metres(raw, scale_m)


def write_depth_png(path: Path | str, ranges_m: npt.ArrayLike, scale_m: float = 0.001) -> None:
    """Write (height, width) metres as a 16-bit PNG in steps of ``scale_m``; no return is written as 0.

    Raises DataError when a range is too large or too small to be told from 'no return' in 16 bits.
    """
    _check_scale(scale_m)
    ranges = _checked_ranges(path, ranges_m)
    valid = np.isfinite(ranges) & (ranges > 0)
    steps = np.rint(np.where(valid, ranges, 0.0) / scale_m)
    lost = valid & ((steps < 1) | (steps >= _NO_RETURN_16_BIT))
    if lost.any():
        raise DataError(
            f"{path}: expected ranges from {scale_m:g} to {(_NO_RETURN_16_BIT - 1) * scale_m:g} m at "
            f"{scale_m:g} m a step, got {ranges[lost][0]:g}"
        )
    import cv2

    done, encoded = cv2.imencode(".png", steps.astype(np.uint16))
    if not done:
        raise DataError(f"{path}: a depth image of shape {ranges.shape} cannot be written as PNG")
    with atomic_path(path) as temporary:
        temporary.write_bytes(encoded.tobytes())


def write_depth_npy(path: Path | str, ranges_m: npt.ArrayLike) -> None:
    """Write (height, width) metres as float32 NPY, without loss; no return is NaN."""
    ranges = _checked_ranges(path, ranges_m)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.save(file, ranges.astype(np.float32), allow_pickle=False)


def _checked_ranges(path: Path | str, ranges_m: npt.ArrayLike) -> npt.NDArray[np.float64]:
    ranges = np.asarray(ranges_m, dtype=np.float64)
    if ranges.ndim != 2 or ranges.size == 0:
        raise DataError(f"{path}: expected ranges of shape (height, width), got {ranges.shape}")
    return ranges


def _check_scale(scale_m: float) -> None:
    if not (math.isfinite(scale_m) and scale_m > 0):
        raise SettingsError(f"scale_m: expected a positive number of metres a step, got {scale_m}")


def _to_metres(raw: npt.NDArray[Any], scale_m: float) -> npt.NDArray[np.float32]:
    if raw.dtype.kind == "f":
        with np.errstate(over="ignore"):
            ranges = raw.astype(np.float32)
        ranges[~(np.isfinite(ranges) & (ranges > 0))] = np.nan
        return ranges
    invalid = raw <= 0
    if raw.dtype.itemsize == 2:
        invalid |= raw == _NO_RETURN_16_BIT
    ranges = (raw * float(scale_m)).astype(np.float32)
    ranges[invalid] = np.nan
    return ranges


def _read_numpy(path: Path) -> npt.NDArray[Any]:
    content = read_bytes(path)
    try:
        loaded = np.load(io.BytesIO(content), allow_pickle=False)
        array = _only_array(path, loaded) if isinstance(loaded, np.lib.npyio.NpzFile) else loaded
    except DataError:
        raise
    except Exception as error:  # damaged headers let errors of the tokenizer and the archive through
        raise DataError(f"{path}: expected a whole NumPy file without objects, got {error}") from error
    array = np.asarray(array)
    if array.ndim != 2 or array.size == 0 or array.dtype.kind not in "fiu":
        raise DataError(
            f"{path}: expected a 2-D array of metres or integer steps, got {array.dtype} {array.shape}"
        )
    if array.dtype.itemsize == 1:
        raise DataError(f"{path}: expected depth of at least 16 bits, got {array.dtype}")
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def _only_array(path: Path, loaded: Any) -> npt.NDArray[Any]:
    with loaded:
        names = list(loaded.files)
        chosen = [name for name in _NPZ_KEYS if name in names] or names
        if len(names) != 1 and chosen == names:
            raise DataError(f"{path}: expected one array, or one named {' or '.join(_NPZ_KEYS)}, got {names}")
        array: npt.NDArray[Any] = loaded[chosen[0]]
        return array


def _read_pgm(path: Path) -> npt.NDArray[Any]:
    content = read_bytes(path)
    match = re.match(rb"(P[25])" + rb"(?:\s|#[^\n]*\n)+(\d+)" * 3 + rb"\s", content)
    if match is None:
        raise DataError(f"{path}: expected a 16-bit PGM (P5 or P2), got another header {content[:16]!r}")
    width, height, largest = (int(match.group(i)) for i in (2, 3, 4))
    if not 255 < largest <= 65535:
        raise DataError(f"{path}: expected a 16-bit PGM (largest value 256 to 65535), got {largest}")
    if width < 1 or height < 1:
        raise DataError(f"{path}: expected at least one pixel, got {width} x {height}")
    if match.group(1) == b"P5":
        pixels = content[match.end() :][: 2 * width * height]
        values = np.frombuffer(pixels[: len(pixels) // 2 * 2], dtype=">u2")
    else:
        try:
            values = np.array(re.sub(rb"#[^\n]*", b"", content[match.end() :]).split(), dtype=np.int64)
        except ValueError as error:
            raise DataError(f"{path}: expected whole numbers, got {error}") from error
    if len(values) != width * height or values.max() > largest or values.min() < 0:
        raise DataError(
            f"{path}: expected {width * height} values from 0 to {largest}, got {len(values)}"
            + (f" up to {values.max()}" if len(values) else "")
        )
    return values.astype(np.uint16).reshape(height, width)
