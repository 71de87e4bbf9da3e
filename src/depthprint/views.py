"""Views: what of a range image is coded. RangeImage -> channels on a grid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.polar_view import polar_view
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.resampling import fill_holes, resample
from depthprint.settings import EncoderSettings, StreamSettings
from depthprint.surflet_pairs import pair_view

__all__ = ["View", "make_view", "make_views", "mirrored_view"]

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True)
class View:
    """Channels to code.

    channels: (c, h, w) float32, zero where nothing is known.
    support: (h, w) bool, true where the channels carry information.
    depth: (h, w) float32 relative depth (0 outside the support), or None for a bird's-eye view.
    """

    channels: Float32Array
    support: npt.NDArray[np.bool_]
    depth: Float32Array | None = None


def make_view(
    image: RangeImage, stream: StreamSettings, settings: EncoderSettings, mirror: bool = False
) -> View:
    """Compute the view that a stream codes; ``mirror`` flips it left to right.

    Raises DataError, naming the frame, when the image has no valid pixel.
    """
    view = _make_view(image, stream, settings, {})
    return mirrored_view(view, stream) if mirror else view


def make_views(image: RangeImage, settings: EncoderSettings) -> Iterator[View]:
    """The views of all streams in order, as ``make_view`` has them; what they share is computed once."""
    surfaces: dict[tuple[int, float], _Surface] = {}
    for stream in settings.streams:
        yield _make_view(image, stream, settings, surfaces)


def mirrored_view(view: View, stream: StreamSettings) -> View:
    """The view of the mirrored image: left and right exchanged, and the normals' sideways part turned round.

    Pairs of points are the same in the mirror.
    """
    if stream.view == "pairs":
        return view
    channels = view.channels[:, :, ::-1].copy()
    if stream.view == "normals":
        np.negative(channels[0], out=channels[0])
    depth = None if view.depth is None else np.ascontiguousarray(view.depth[:, ::-1])
    return View(channels, np.ascontiguousarray(view.support[:, ::-1]), depth)


@dataclass(frozen=True)
class _Surface:
    """Smoothed depth (h, w) in metres, where it is known, metres a pixel, and depth relative to its median."""

    z: npt.NDArray[np.float64]
    support: npt.NDArray[np.bool_]
    pixel: npt.NDArray[np.float64]
    relative: npt.NDArray[np.float64]


def _make_view(
    image: RangeImage,
    stream: StreamSettings,
    settings: EncoderSettings,
    surfaces: dict[tuple[int, float], _Surface],
) -> View:
    image.require_returns()
    if stream.view == "polar":
        channels = polar_view(image, settings.polar, stream.channels)
        return View(np.ascontiguousarray(channels), np.ones(channels.shape[1:], dtype=bool))
    if stream.view == "pairs":
        channels = pair_view(image, stream.channels)
        return View(channels, np.ones(channels.shape[1:], dtype=bool))
    if stream.view == "raw-depth":
        depth = fill_holes(resample(image, stream.size, stream.size).ranges_m)
        # A planar scan is one row: repeated, it is an image that whole-image atoms can code.
        depth = np.broadcast_to(depth, (stream.size, stream.size))
        channels = np.ascontiguousarray(depth[None], dtype=np.float32)
        return View(channels, np.ones(depth.shape, dtype=bool), channels[0])
    key = (stream.size, stream.smoothing)
    if key not in surfaces:
        surfaces[key] = _smoothed_surface(image, *key)
    return _surface_view(surfaces[key], stream)


def _smoothed_surface(image: RangeImage, size: int, smoothing: float) -> _Surface:
    """The masked object, or the whole frame, on a grid of twice the view's size."""
    if image.mask is None:
        z, support, pixel = _frame_scene(image, size)
    else:
        z, support, pixel = _frame_object(image, size)
    z = _smooth(z, support, smoothing)
    # Metres for a scene: moving towards it then only adds a constant. An object has a size of its own.
    scale = 1.0 if image.mask is None else float(np.median(pixel[support])) * max(z.shape)
    return _Surface(z, support, pixel, np.where(support, (np.median(z[support]) - z) / scale, 0.0))


def _surface_view(surface: _Surface, stream: StreamSettings) -> View:
    """Relative depth or surface normals, halved in size."""
    z, support = surface.z, surface.support
    relative = _halve(surface.relative[None]).astype(np.float32)
    channels = relative
    if stream.view != "depth":
        gy, gx = np.gradient(z)
        normals = np.stack([gx / surface.pixel, gy / surface.pixel, np.ones_like(z)])
        normals /= np.sqrt(normals[0] ** 2 + normals[1] ** 2 + 1.0)
        channels = _halve(np.where(support, normals, 0.0)).astype(np.float32)
    return View(channels, _halve_mask(support), relative[0])


def _frame_scene(
    image: RangeImage, size: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.float64]]:
    small = resample(image, size, size)
    support = small.valid
    z = fill_holes(small.ranges_m).astype(np.float64)
    return z, support, z * _pixel_angle(small)


def _pixel_angle(image: RangeImage) -> float:
    """Metres on the surface per pixel and metre of depth (mean of both axes)."""
    projection = image.projection
    if isinstance(projection, Pinhole):
        return 0.5 / projection.fx + 0.5 / projection.fy
    return float(projection.horizontal_fov_rad) / projection.width


def _frame_object(
    image: RangeImage, size: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.float64]]:
    """Crop to the mask's box, keep the aspect, centre it with a small margin."""
    mask = np.asarray(image.mask) & image.valid
    if not mask.any():
        mask = image.valid
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    z = np.where(mask, image.ranges_m, np.nan)[top:bottom, left:right].astype(np.float64)
    inside = np.asarray(image.mask)[top:bottom, left:right]
    longest = size - 4
    step = max(z.shape) / longest
    # Even, so that the frame of the mirrored object is the mirrored frame.
    height, width = (2 * max(1, round(extent / step / 2)) for extent in z.shape)
    rows_at = np.minimum(((np.arange(height) + 0.5) * z.shape[0] / height).astype(int), z.shape[0] - 1)
    columns_at = np.minimum(((np.arange(width) + 0.5) * z.shape[1] / width).astype(int), z.shape[1] - 1)
    filled = fill_holes(z.astype(np.float32)).astype(np.float64)
    middle = float(np.median(z[np.isfinite(z)]))
    framed = np.full((size, size), middle)
    support = np.zeros((size, size), dtype=bool)
    y0, x0 = (size - height) // 2, (size - width) // 2
    framed[y0 : y0 + height, x0 : x0 + width] = filled[np.ix_(rows_at, columns_at)]
    support[y0 : y0 + height, x0 : x0 + width] = inside[np.ix_(rows_at, columns_at)]
    if not support.any():
        support[y0 : y0 + height, x0 : x0 + width] = True
    focal = float(getattr(image.projection, "fx", 1.0))
    pixel = np.full((size, size), middle * step / focal)
    return framed, support, pixel


def _smooth(
    z: npt.NDArray[np.float64], support: npt.NDArray[np.bool_], sigma: float
) -> npt.NDArray[np.float64]:
    """Gaussian smoothing normalised by the support, so that nothing bleeds in from outside."""
    if sigma <= 0:
        return z
    from scipy.ndimage import gaussian_filter

    weight = gaussian_filter(support.astype(np.float64), sigma)
    total = gaussian_filter(np.where(support, z, 0.0), sigma)
    return np.where(weight > 1e-6, total / np.maximum(weight, 1e-6), z)


def _halve(channels: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    _, h, w = channels.shape
    even = channels[:, : h // 2 * 2, : w // 2 * 2]
    pairs = even[:, ::2] + even[:, 1::2]
    return np.asarray((pairs[:, :, ::2] + pairs[:, :, 1::2]) / 4)


def _halve_mask(support: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    h, w = support.shape
    even = support[: h // 2 * 2, : w // 2 * 2]
    pairs = even[::2] | even[1::2]
    return np.asarray(pairs[:, ::2] | pairs[:, 1::2])
