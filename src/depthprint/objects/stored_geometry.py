"""Depth crops as a saved recogniser keeps them for alignment: thinned out, in 16 bits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.object_surface import object_surface
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage

if TYPE_CHECKING:
    from depthprint._kernels.surface_alignment import SeenSurface

__all__ = ["LONGEST_SIDE_PX", "StoredGeometry", "thinned"]

LONGEST_SIDE_PX = 64
_STEPS = 65535
# Some 50 kB each.
_KEPT_SURFACES = 4096


def thinned(image: RangeImage) -> RangeImage:
    """Every n-th pixel of every n-th row of a pinhole image, so that no side is longer than 64 pixels.

    Raises DataError for other than pinhole images.
    """
    camera = image.projection
    if not isinstance(camera, Pinhole):
        raise DataError(f"{image.source or 'view'}: expected a pinhole image, got {type(camera).__name__}")
    step = math.ceil(max(image.shape) / LONGEST_SIDE_PX)
    ranges_m = image.ranges_m[::step, ::step]
    height, width = ranges_m.shape
    fx, fy, cx, cy = (value / step for value in _lens(camera))
    small = Pinhole(fx, fy, cx, cy, width, height)
    mask = None if image.mask is None else image.mask[::step, ::step]
    return image.replace(ranges_m=ranges_m, projection=small, mask=mask)


@dataclass(frozen=True)
class StoredGeometry:
    """Views (n) to align queries with, one after the other; arrays are read-only.

    depths (p,) uint16: 0 for no return, else multiples of ``steps_m`` (n,). objects (p,) bool: what is masked. shapes
    (n, 2): height and width. lenses (n, 4): focal lengths and centre. Raises DataError where these do not fit together.
    """

    depths: npt.NDArray[np.uint16]
    objects: npt.NDArray[np.bool_]
    steps_m: npt.NDArray[np.float64]
    shapes: npt.NDArray[np.int64]
    lenses: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        n, pixels = len(self.shapes), int(self.shapes.prod(axis=1).sum())
        if not (self.depths.shape == self.objects.shape == (pixels,)) or self.shapes.shape != (n, 2):
            raise DataError(
                f"stored geometry: expected {pixels} pixels, got {self.depths.shape} depths and "
                f"{self.objects.shape} of masks"
            )
        if self.steps_m.shape != (n,) or self.lenses.shape != (n, 4):
            raise DataError(
                f"stored geometry: expected {n} steps and lenses, got {self.steps_m.shape} and {self.lenses.shape}"
            )
        for array in (self.depths, self.objects, self.steps_m, self.shapes, self.lenses):
            array.setflags(write=False)

    @classmethod
    def of(cls, images: Sequence[RangeImage]) -> StoredGeometry:
        """Keep pinhole views, without mask all that returned as the object; raises as ``thinned`` does."""
        small = [thinned(image.require_returns()) for image in images]
        steps_m = np.array([float(np.nanmax(image.ranges_m)) / _STEPS for image in small])
        depths = [
            np.where(image.valid, np.maximum(np.round(image.ranges_m / step), 1), 0).astype(np.uint16)
            for image, step in zip(small, steps_m, strict=True)
        ]
        objects = [image.valid if image.mask is None else image.mask for image in small]
        return cls(
            np.concatenate([values.ravel() for values in depths]),
            np.concatenate([values.ravel() for values in objects]),
            steps_m,
            np.array([image.shape for image in small], dtype=np.int64),
            np.array([_lens(image.projection) for image in small]),
        )

    def parts(self) -> dict[str, npt.NDArray[Any]]:
        """Arrays that a file keeps."""
        return {
            "geometry_depths": self.depths,
            "geometry_objects": np.packbits(self.objects),
            "geometry_steps_m": self.steps_m,
            "geometry_shapes": self.shapes,
            "geometry_lenses": self.lenses,
        }

    @classmethod
    def of_parts(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> StoredGeometry:
        """What ``parts`` gave; raises KeyError where one is missing, DataError where they do not fit together."""
        depths = arrays["geometry_depths"]
        objects = np.unpackbits(arrays["geometry_objects"])[: len(depths)].astype(bool)
        return cls(
            depths, objects, arrays["geometry_steps_m"], arrays["geometry_shapes"], arrays["geometry_lenses"]
        )

    def __len__(self) -> int:
        return len(self.shapes)

    def taken(self, rows: npt.NDArray[np.integer]) -> StoredGeometry:
        """Some of the views; one may be taken several times."""
        pixels = [slice(self._firsts[k], self._firsts[k + 1]) for k in rows]
        return StoredGeometry(
            np.concatenate([self.depths[of_view] for of_view in pixels]),
            np.concatenate([self.objects[of_view] for of_view in pixels]),
            self.steps_m[rows],
            self.shapes[rows],
            self.lenses[rows],
        )

    def surface(self, number: int) -> SeenSurface:
        """The surface of a view, made when it is asked for; those made last are kept."""
        if number not in self._surfaces:
            if len(self._surfaces) == _KEPT_SURFACES:
                del self._surfaces[next(iter(self._surfaces))]
            self._surfaces[number] = object_surface(self.image(number))
        return self._surfaces[number]

    def image(self, number: int) -> RangeImage:
        """A view as it is kept."""
        height, width = (int(extent) for extent in self.shapes[number])
        pixels = slice(self._firsts[number], self._firsts[number + 1])
        depths = self.depths[pixels].reshape(height, width)
        ranges_m = np.where(depths > 0, depths * self.steps_m[number], np.nan).astype(np.float32)
        fx, fy, cx, cy = (float(value) for value in self.lenses[number])
        camera = Pinhole(fx, fy, cx, cy, width, height)
        return RangeImage(ranges_m, camera, mask=self.objects[pixels].reshape(height, width))

    @cached_property
    def _firsts(self) -> npt.NDArray[np.int64]:
        return np.concatenate([[0], np.cumsum(self.shapes.prod(axis=1))]).astype(np.int64)

    @cached_property
    def _surfaces(self) -> dict[int, SeenSurface]:
        return {}


def _lens(camera: Any) -> tuple[float, float, float, float]:
    return camera.fx, camera.fy, camera.cx, camera.cy
