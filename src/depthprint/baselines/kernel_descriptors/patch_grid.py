"""Where patches lie on a crop, and what each descriptor returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage

__all__ = [
    "GRID_STEP_PX",
    "PatchDescriptors",
    "centre_positions",
    "crop_depth",
    "depth_and_points",
    "mirrored_image",
    "patch_corners",
]

GRID_STEP_PX = 8


@dataclass(frozen=True)
class PatchDescriptors:
    """Descriptors of one crop.

    vectors: (m, k) float32. positions: (m, 2) float32, centres (x, y) as shares of the crop's width and height.
    """

    vectors: npt.NDArray[np.float32]
    positions: npt.NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.vectors.ndim != 2 or self.positions.shape != (len(self.vectors), 2):
            raise DataError(
                f"PatchDescriptors: expected vectors (m, k) and positions (m, 2), got {self.vectors.shape} "
                f"and {self.positions.shape}"
            )
        self.vectors.setflags(write=False)
        self.positions.setflags(write=False)

    def mirrored(self) -> PatchDescriptors:
        """The same vectors at mirrored places: the mirror image's, for descriptors that no mirror changes."""
        positions = self.positions.copy()
        positions[:, 0] = 1.0 - positions[:, 0]
        return PatchDescriptors(self.vectors, positions)


def patch_corners(shape: tuple[int, ...], patch: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """First rows and first columns of the patches of a centred grid."""
    rows, columns = (
        np.arange(((size - patch) % GRID_STEP_PX) // 2, size - patch + 1, GRID_STEP_PX, dtype=np.int64)
        for size in shape
    )
    return rows, columns


def crop_depth(image: RangeImage, patch: int, masked: bool = False) -> npt.NDArray[np.float32]:
    """Depth (h, w) in metres with 0 for no return.

    A crop smaller than a patch is centred among pixels without return. ``masked``: what is not the object has
    no return. Raises DataError for other than pinhole images, and where nothing returned.
    """
    return _known_depth(image, _known_pixels(image, masked), patch)


def depth_and_points(
    image: RangeImage, patch: int, masked: bool = False
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
    """``crop_depth``, and the points (h, w, 3) of the camera, zero for no return. Raises as it does."""
    known = _known_pixels(image, masked)
    points = np.where(known[..., None], image.points(), np.float32(0.0)).astype(np.float64)
    if min(image.shape) < patch:
        points = np.pad(points, [*_margins(image.shape, patch), (0, 0)])
    return _known_depth(image, known, patch), points


def _known_depth(image: RangeImage, known: npt.NDArray[np.bool_], patch: int) -> npt.NDArray[np.float32]:
    depth = np.where(known, image.ranges_m, np.float32(0.0))
    return np.pad(depth, _margins(image.shape, patch)) if min(image.shape) < patch else depth


def _known_pixels(image: RangeImage, masked: bool) -> npt.NDArray[np.bool_]:
    if not isinstance(image.projection, Pinhole):
        raise DataError(
            f"{image.source or 'kernel descriptors'}: expected a pinhole image, got {type(image.projection).__name__}"
        )
    image.require_returns()
    known = image.valid
    if masked and image.mask is not None and (known & image.mask).any():
        known = known & image.mask
    return known


def _margins(shape: tuple[int, int], patch: int) -> list[tuple[int, int]]:
    spare = [max(0, patch - size) for size in shape]
    return [(extra // 2, extra - extra // 2) for extra in spare]


def centre_positions(
    rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], patch: int, shape: tuple[int, ...]
) -> npt.NDArray[np.float32]:
    """Centres of all patches, row by row, as shares of the extent: (rows * columns, 2)."""
    places = np.empty((len(rows), len(columns), 2), dtype=np.float32)
    places[:, :, 0] = (columns + patch / 2) / shape[1]
    places[:, :, 1] = ((rows + patch / 2) / shape[0])[:, None]
    return places.reshape(-1, 2)


def mirrored_image(image: RangeImage) -> RangeImage:
    """The pinhole image as a mirror would show it, left and right exchanged; DataError for other projections."""
    camera = image.projection
    if not isinstance(camera, Pinhole):
        raise DataError(
            f"{image.source or 'mirrored_image'}: expected a pinhole image, got {type(camera).__name__}"
        )
    turned = Pinhole(
        camera.fx, camera.fy, camera.width - 1 - camera.cx, camera.cy, camera.width, camera.height
    )
    mask = None if image.mask is None else image.mask[:, ::-1]
    return image.replace(ranges_m=image.ranges_m[:, ::-1], projection=turned, mask=mask)
