"""PCD point clouds (version 0.7 and its elders): ascii, binary and binary_compressed."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.io._files import read_bytes
from depthprint.io._point_cloud import PointCloud
from depthprint.io.atomic import atomic_path

__all__ = ["read_pcd", "write_pcd"]

_KINDS = {"F": "f", "I": "i", "U": "u"}
_FORMS = ("ascii", "binary", "binary_compressed")
_LARGEST_POINT_COUNT = 2**31
_LZF_LARGEST_RATIO = 88  # three bytes stand for 264 at most
_IDENTITY_VIEWPOINT = ["0", "0", "0", "1", "0", "0", "0"]


@dataclass(frozen=True)
class _Header:
    names: list[str]
    types: list[str]
    counts: list[int]
    width: int
    height: int
    viewpoint: list[float]
    form: str
    data_at: int

    @property
    def points(self) -> int:
        return self.width * self.height

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(
            [(f"{i}", kind, (n,)) for i, (kind, n) in enumerate(zip(self.types, self.counts, strict=True))]
        )


def read_pcd(path: Path | str) -> PointCloud:
    """Read points, size, viewpoint and intensity of a PCD file; other fields are passed over.

    Raises DataError naming the file for headers without x, y, z, for cut or damaged data, and for another
    number of points than the header states. Format: the Point Cloud Library's PCD file description.
    """
    path = Path(path)
    content = read_bytes(path)
    header = _parse_header(path, content)
    if header.form == "ascii":
        columns = _ascii_columns(path, header, content[header.data_at :])
    elif header.form == "binary":
        columns = _binary_columns(path, header, content[header.data_at :])
    else:
        columns = _compressed_columns(path, header, content[header.data_at :])
    xyz = [columns[header.names.index(axis)][:, 0] for axis in "xyz"]
    intensity = None
    if "intensity" in header.names:
        intensity = columns[header.names.index("intensity")][:, 0]
    return PointCloud(
        np.stack(xyz, axis=1).astype(np.float32),
        width=header.width,
        height=header.height,
        viewpoint=np.array(header.viewpoint),
        intensity=None if intensity is None else intensity.astype(np.float32),
        source=str(path),
    )


def write_pcd(path: Path | str, cloud: PointCloud, form: str = "binary") -> None:
    """Write a cloud as float32 fields x, y, z (and intensity) in form ascii, binary or binary_compressed."""
    if form not in _FORMS:
        raise SettingsError(f"write_pcd: expected a form of {', '.join(_FORMS)}, got {form!r}")
    names = ["x", "y", "z"]
    columns = [cloud.points[:, i] for i in range(3)]
    if cloud.intensity is not None:
        names.append("intensity")
        columns.append(cloud.intensity)
    viewpoint = _IDENTITY_VIEWPOINT if cloud.viewpoint is None else [repr(float(v)) for v in cloud.viewpoint]
    n = len(names)
    header = (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {' '.join(names)}\n"
        f"SIZE {' '.join('4' * n)}\nTYPE {' '.join('F' * n)}\nCOUNT {' '.join('1' * n)}\n"
        f"WIDTH {cloud.width}\nHEIGHT {cloud.height}\n"
        f"VIEWPOINT {' '.join(viewpoint)}\n"
        f"POINTS {len(cloud)}\nDATA {form}\n"
    )
    with atomic_path(path) as temporary:
        temporary.write_bytes(header.encode("ascii") + _encoded(np.stack(columns).astype("<f4"), form))


def _encoded(columns: npt.NDArray[np.float32], form: str) -> bytes:
    if form == "ascii":
        lines = (" ".join(f"{value:.9g}" for value in row) for row in columns.T.tolist())
        return "".join(f"{line}\n" for line in lines).encode("ascii")
    if form == "binary":
        return np.ascontiguousarray(columns.T).tobytes()
    from depthprint._kernels.lzf import lzf_compress

    raw = np.frombuffer(columns.tobytes(), dtype=np.uint8)
    compressed: bytes = lzf_compress(raw).tobytes()
    return struct.pack("<II", len(compressed), len(raw)) + compressed


def _parse_header(path: Path, content: bytes) -> _Header:
    entries: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in entries:
        end = content.find(b"\n", at)
        if end < 0 or at > 65536:
            raise DataError(f"{path}: expected a PCD header that ends in a DATA line, got none")
        words = content[at:end].decode("ascii", errors="replace").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
    try:
        names = entries.get("FIELDS") or entries["COLUMNS"]
        kinds = entries.get("TYPE", ["F"] * len(names))
        types = [f"<{_KINDS[kind]}{int(size)}" for kind, size in zip(kinds, entries["SIZE"], strict=True)]
        counts = [int(count) for count in entries.get("COUNT", ["1"] * len(names))]
        points = int(entries["POINTS"][0]) if "POINTS" in entries else None
        width = int(entries["WIDTH"][0]) if "WIDTH" in entries else int(points or 0)
        height = int(entries["HEIGHT"][0]) if "HEIGHT" in entries else 1
        viewpoint = [float(value) for value in entries.get("VIEWPOINT", _IDENTITY_VIEWPOINT)]
        form = entries["DATA"][0].lower()
        sizes = [np.dtype(kind).itemsize for kind in types]
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise DataError(
            f"{path}: expected a PCD header, got one with a bad or missing entry ({error})"
        ) from error
    if not len(names) == len(types) == len(counts) == len(sizes):
        raise DataError(f"{path}: expected as many FIELDS as SIZE, TYPE and COUNT entries in the PCD header")
    if not set("xyz") <= set(names):
        raise DataError(f"{path}: expected fields x, y and z, got {' '.join(names)}")
    if form not in _FORMS:
        raise DataError(f"{path}: expected DATA of {', '.join(_FORMS)}, got {form!r}")
    if min(counts) < 1 or len(viewpoint) != 7 or not all(map(math.isfinite, viewpoint)):
        raise DataError(f"{path}: expected COUNT of at least 1 and a VIEWPOINT of 7 numbers")
    if width < 1 or height < 1 or width * height > _LARGEST_POINT_COUNT:
        raise DataError(f"{path}: expected at least one point, got WIDTH {width} and HEIGHT {height}")
    if points is not None and points != width * height:
        raise DataError(f"{path}: expected POINTS = WIDTH * HEIGHT, got {points}, {width} and {height}")
    return _Header(names, types, counts, width, height, viewpoint, form, at)


def _ascii_columns(path: Path, header: _Header, data: bytes) -> list[npt.NDArray[Any]]:
    rows = [line.split() for line in data.splitlines() if line.strip()]
    per_row = sum(header.counts)
    if len(rows) != header.points:
        raise DataError(f"{path}: expected {header.points} points, got {len(rows)}")
    for i, row in enumerate(rows):
        if len(row) != per_row:
            raise DataError(f"{path}: point {i}: expected {per_row} numbers, got {len(row)}")
    try:
        table = np.array(rows, dtype=np.bytes_).astype(np.float64)
    except ValueError as error:
        raise DataError(f"{path}: expected numbers, got {error}") from error
    return np.split(table, np.cumsum(header.counts)[:-1], axis=1)


def _binary_columns(path: Path, header: _Header, data: bytes) -> list[npt.NDArray[Any]]:
    needed = header.points * header.dtype.itemsize
    if len(data) < needed:
        raise DataError(f"{path}: expected {needed} bytes of points, got a truncated {len(data)}")
    table = np.frombuffer(data, dtype=header.dtype, count=header.points)
    return [table[str(i)] for i in range(len(header.names))]


def _compressed_columns(path: Path, header: _Header, data: bytes) -> list[npt.NDArray[Any]]:
    from depthprint._kernels.lzf import lzf_decompress

    needed = header.points * header.dtype.itemsize
    if len(data) < 8:
        raise DataError(f"{path}: expected compressed points, got a truncated file")
    compressed, size = struct.unpack_from("<II", data)
    if size != needed or len(data) < 8 + compressed or size > _LZF_LARGEST_RATIO * compressed:
        raise DataError(
            f"{path}: expected {needed} bytes of points from {compressed} compressed ones, "
            f"got {size} from {len(data) - 8}"
        )
    raw, whole = lzf_decompress(np.frombuffer(data, dtype=np.uint8, count=compressed, offset=8), needed)
    if not whole:
        raise DataError(f"{path}: expected {needed} bytes of compressed points, got damaged data")
    columns: list[npt.NDArray[Any]] = []
    at = 0
    for kind, count in zip(header.types, header.counts, strict=True):
        size = np.dtype(kind).itemsize * count * header.points
        columns.append(raw[at : at + size].view(kind).reshape(header.points, count))
        at += size
    return columns
