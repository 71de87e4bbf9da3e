"""PLY point clouds: ascii, binary little and big endian."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.io._files import read_bytes
from depthprint.io._point_cloud import PointCloud
from depthprint.io.atomic import atomic_path

__all__ = ["read_ply", "write_ply"]

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_INTENSITY_NAMES = ("intensity", "scalar_intensity", "reflectance")


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str]]
    has_lists: bool

    def dtype(self, order: str) -> np.dtype[Any]:
        return np.dtype([(name, order + kind) for name, kind in self.properties])


def read_ply(path: Path | str) -> PointCloud:
    """Read the vertices' x, y, z and intensity of a PLY file; other properties and elements are passed over.

    Raises DataError naming the file for headers without vertices, for cut data, and for lists before or in
    the vertices. Format: G. Turk, The PLY Polygon File Format.
    """
    path = Path(path)
    content = read_bytes(path)
    form, elements, data_at = _parse_header(path, content)
    before: list[_Element] = []
    for element in elements:
        if element.name == "vertex":
            break
        before.append(element)
    else:
        raise DataError(f"{path}: expected an element 'vertex', got {[e.name for e in elements]}")
    names = [name for name, _ in element.properties]
    if not set("xyz") <= set(names):
        raise DataError(f"{path}: expected vertices with x, y and z, got {' '.join(names)}")
    if element.has_lists or len(set(names)) != len(names):
        raise DataError(f"{path}: expected vertices with plain, different properties, got {' '.join(names)}")
    if element.count < 1:
        raise DataError(f"{path}: expected at least one vertex, got none")
    table: Any
    if form == "ascii":
        table = _ascii_vertices(path, before, element, content[data_at:])
    else:
        table = _binary_vertices(path, before, element, content[data_at:], _BYTE_ORDERS[form])
    intensity = next((table[name] for name in _INTENSITY_NAMES if name in names), None)
    return PointCloud(
        np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float32),
        width=element.count,
        intensity=None if intensity is None else intensity.astype(np.float32),
        source=str(path),
    )


def write_ply(path: Path | str, cloud: PointCloud, form: str = "binary_little_endian") -> None:
    """Write a cloud as float vertices x, y, z (and intensity); organisation and viewpoint are not kept."""
    if form not in _BYTE_ORDERS:
        raise SettingsError(f"write_ply: expected a form of {', '.join(_BYTE_ORDERS)}, got {form!r}")
    names = ["x", "y", "z"]
    table = cloud.points
    if cloud.intensity is not None:
        names.append("intensity")
        table = np.column_stack([table, cloud.intensity])
    properties = "".join(f"property float {name}\n" for name in names)
    header = f"ply\nformat {form} 1.0\nelement vertex {len(cloud)}\n{properties}end_header\n"
    if form == "ascii":
        body = "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in table.tolist()).encode("ascii")
    else:
        body = table.astype(f"{_BYTE_ORDERS[form]}f4").tobytes()
    with atomic_path(path) as temporary:
        temporary.write_bytes(header.encode("ascii") + body)


def _parse_header(path: Path, content: bytes) -> tuple[str, list[_Element], int]:
    if not content.startswith(b"ply"):
        raise DataError(f"{path}: expected a file that begins with 'ply', got {content[:8]!r}")
    form = ""
    elements: list[_Element] = []
    at = 0
    while True:
        end = content.find(b"\n", at)
        if end < 0 or at > 65536:
            raise DataError(f"{path}: expected a PLY header that ends in 'end_header', got none")
        line = content[at:end].decode("ascii", errors="replace").strip()
        words = line.split()
        at = end + 1
        try:
            if not words or words[0] in ("ply", "comment", "obj_info"):
                continue
            if words[0] == "end_header":
                break
            if words[0] == "format":
                form = words[1]
            elif words[0] == "element":
                elements.append(_Element(words[1], int(words[2]), [], False))
            elif words[0] == "property":
                last = elements[-1]
                if words[1] == "list":
                    elements[-1] = _Element(last.name, last.count, last.properties, True)
                else:
                    last.properties.append((words[2], _TYPES[words[1]]))
            else:
                raise DataError(f"{path}: expected a PLY header, got the line {line!r}")
        except (IndexError, KeyError, ValueError) as error:
            if isinstance(error, DataError):
                raise
            raise DataError(f"{path}: expected a PLY header, got the line {line!r}") from error
    if form not in _BYTE_ORDERS:
        raise DataError(f"{path}: expected a format of {', '.join(_BYTE_ORDERS)}, got {form!r}")
    return form, elements, at


def _ascii_vertices(
    path: Path, before: list[_Element], vertex: _Element, data: bytes
) -> dict[str, npt.NDArray[np.float64]]:
    lines = [line.split() for line in data.splitlines() if line.strip()]
    skip = sum(element.count for element in before)
    rows = lines[skip : skip + vertex.count]
    if len(rows) != vertex.count:
        raise DataError(f"{path}: expected {vertex.count} vertices, got {len(rows)}")
    for i, row in enumerate(rows):
        if len(row) != len(vertex.properties):
            raise DataError(f"{path}: vertex {i}: expected {len(vertex.properties)} numbers, got {len(row)}")
    try:
        table = np.array(rows, dtype=np.bytes_).astype(np.float64)
    except ValueError as error:
        raise DataError(f"{path}: expected numbers, got {error}") from error
    return {name: table[:, i] for i, (name, _) in enumerate(vertex.properties)}


def _binary_vertices(
    path: Path, before: list[_Element], vertex: _Element, data: bytes, order: str
) -> npt.NDArray[Any]:
    if any(element.has_lists for element in before):
        raise DataError(f"{path}: expected vertices before the elements with lists")
    skip = sum(element.count * element.dtype(order).itemsize for element in before)
    dtype = vertex.dtype(order)
    needed = skip + vertex.count * dtype.itemsize
    if len(data) < needed:
        raise DataError(f"{path}: expected {needed} bytes of points, got a truncated {len(data)}")
    return np.frombuffer(data, dtype=dtype, count=vertex.count, offset=skip)
