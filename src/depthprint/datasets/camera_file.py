"""camera.json: how the pixels of a folder of frames become points."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from depthprint.errors import DataError, DepthprintError
from depthprint.projection import Pinhole, Projection, Spherical

__all__ = ["CameraDescription", "read_camera_file"]

PINHOLE_FIELDS = ("fx", "fy", "cx", "cy")
ANGLE_FIELDS = ("azimuth_min_rad", "azimuth_max_rad", "elevation_min_rad", "elevation_max_rad")
SIZE_FIELDS = ("width", "height")
OTHER_FIELDS = ("projection", "depth_scale_m", "sensor_height_m", "simulated")


@dataclass(frozen=True)
class CameraDescription:
    """Fields of camera.json, each None where it was not given; ``source`` names the file or the options.

    projection: 'pinhole' or 'spherical'. fx, fy, cx, cy, width, height in pixels. *_rad: limits of a
    spherical image. depth_scale_m: metres a unit of an integer image. sensor_height_m: above level ground,
    sensor level.
    simulated: whether the depth was simulated.
    """

    projection: str | None = None
    fx: float | None = None
    fy: float | None = None
    cx: float | None = None
    cy: float | None = None
    width: int | None = None
    height: int | None = None
    azimuth_min_rad: float | None = None
    azimuth_max_rad: float | None = None
    elevation_min_rad: float | None = None
    elevation_max_rad: float | None = None
    depth_scale_m: float | None = None
    sensor_height_m: float | None = None
    simulated: bool = False
    source: str = "options"

    @classmethod
    def from_fields(
        cls, fields: Mapping[str, Any], source: str, error: type[DepthprintError]
    ) -> CameraDescription:
        """Validate fields by name; raises ``error`` for an unknown name or a value that it cannot have."""
        known = (*PINHOLE_FIELDS, *SIZE_FIELDS, *ANGLE_FIELDS, *OTHER_FIELDS)
        unknown = sorted(set(fields) - set(known))
        if unknown:
            raise error(f"{source}: unknown field {unknown[0]!r}, expected some of {', '.join(known)}")
        checked = {k: _checked(k, v, source, error) for k, v in fields.items() if v is not None}
        return cls(**checked, source=source)

    def overridden_by(self, other: CameraDescription) -> CameraDescription:
        """Take each field that ``other`` states, and the rest from here."""
        stated = {k: v for k, v in vars(other).items() if v is not None and v is not False and k != "source"}
        return replace(self, **stated)

    @property
    def has_intrinsics(self) -> bool:
        """Whether any pinhole parameter was given."""
        return any(getattr(self, name) is not None for name in PINHOLE_FIELDS)

    def pinhole(self, shape: tuple[int, int], first: Path | str) -> Pinhole:
        """Projection of images of ``shape`` (height, width); DataError where a field lacks or disagrees."""
        missing = [name for name in PINHOLE_FIELDS if getattr(self, name) is None]
        if missing:
            raise DataError(
                f"{self.source}: a pinhole camera needs fx, fy, cx, cy; missing {', '.join(missing)}"
            )
        fx, fy, cx, cy = (float(getattr(self, name)) for name in PINHOLE_FIELDS)
        self.check_size(shape, first)
        return Pinhole(fx, fy, cx, cy, shape[1], shape[0])

    def spherical(
        self, default: Spherical, shape: tuple[int, int] | None = None, first: Path | str = ""
    ) -> Spherical:
        """Spherical projection with the stated fields, else ``default``'s; ``shape`` binds its size."""
        if shape is not None:
            self.check_size(shape, first)
        stated = {
            name: getattr(self, name)
            for name in (*SIZE_FIELDS, *ANGLE_FIELDS)
            if getattr(self, name) is not None
        }
        if shape is not None:
            stated.update(width=shape[1], height=shape[0])
        return replace(default, **stated)

    def check_size(self, shape: tuple[int, int], first: Path | str) -> None:
        """Raise DataError when the stated size is not that of the images."""
        for name, actual in (("width", shape[1]), ("height", shape[0])):
            stated = getattr(self, name)
            if stated is not None and stated != actual:
                raise DataError(f"{first}: {self.source} states {name} {stated}, got {actual} pixels")


def read_camera_file(path: Path | str) -> CameraDescription:
    """Read a camera.json; raises DataError naming the file for broken JSON, unknown fields or bad values."""
    path = Path(path)
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise DataError(f"{path}: expected JSON, got {error}") from error
    if not isinstance(fields, dict):
        raise DataError(f"{path}: expected a JSON object, got {type(fields).__name__}")
    return CameraDescription.from_fields(fields, str(path), DataError)


def projection_frame_up(projection: Projection) -> tuple[float, float, float]:
    """'Up' in the native frame of a projection: -y of a camera, z of a scanner."""
    return (0.0, -1.0, 0.0) if isinstance(projection, Pinhole) else (0.0, 0.0, 1.0)


def _checked(name: str, value: Any, source: str, error: type[DepthprintError]) -> Any:
    if name == "projection":
        if value not in ("pinhole", "spherical"):
            raise error(f"{source}: projection: expected 'pinhole' or 'spherical', got {value!r}")
        return value
    if name == "simulated":
        if not isinstance(value, bool):
            raise error(f"{source}: simulated: expected true or false, got {value!r}")
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise error(f"{source}: {name}: expected a finite number, got {value!r}")
    if name in SIZE_FIELDS:
        if value < 1 or value != int(value):
            raise error(f"{source}: {name}: expected a whole number >= 1, got {value!r}")
        return int(value)
    if name in ("fx", "fy", "depth_scale_m", "sensor_height_m") and value <= 0:
        raise error(f"{source}: {name}: expected a positive number, got {value!r}")
    return float(value)
