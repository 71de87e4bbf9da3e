"""What a crop shows of an object, against the same by scipy and plain numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from depthprint import Pinhole, RangeImage
from depthprint._kernels.seen_object import describe_seen, smooth_within
from depthprint._kernels.surface_alignment import BACKGROUND, OBJECT, UNKNOWN
from depthprint.object_surface import object_surface

BELL = np.exp(-0.5 * np.arange(5.0) ** 2)
TAPS = BELL / (2 * BELL.sum() - 1)


def crop(height: int, width: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    ranges_m = (1.0 + 0.1 * rng.random((height, width))).astype(np.float32)
    ranges_m[rng.random((height, width)) < 0.1] = np.nan
    seen = np.isfinite(ranges_m) & (rng.random((height, width)) < 0.7)
    seen[height // 2, width // 2] = True
    ranges_m[height // 2, width // 2] = 1.0
    return ranges_m, seen


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 20), st.integers(1, 20), st.integers(0, 2**16))
def test_smoothing_is_scipys_gaussian_over_the_object_alone(height: int, width: int, seed: int) -> None:
    ranges_m, seen = crop(height, width, seed)
    weight = gaussian_filter(seen.astype(np.float64), 1.0)
    total = gaussian_filter(np.where(seen, ranges_m, 0.0).astype(np.float64), 1.0)
    expected = np.where(seen, total / np.maximum(weight, 1e-6), 0.0)
    np.testing.assert_allclose(smooth_within(ranges_m, seen, TAPS), expected, rtol=0, atol=1e-14)


def test_pixels_are_the_object_what_lies_beside_it_or_unknown() -> None:
    ranges_m, seen = crop(12, 9, 3)
    kinds = describe_seen(ranges_m, seen, TAPS, np.array([50.0, 60.0, 4.0, 6.0]))[3]
    np.testing.assert_array_equal(kinds == OBJECT, seen)
    np.testing.assert_array_equal(kinds == UNKNOWN, ~np.isfinite(ranges_m))
    np.testing.assert_array_equal(kinds == BACKGROUND, np.isfinite(ranges_m) & ~seen)


def test_normals_of_a_plane_are_its_own_up_to_the_border() -> None:
    camera = Pinhole(500.0, 520.0, 19.5, 14.5, 40, 30)
    plane = np.array([0.3, -0.2, -1.0]) / np.linalg.norm([0.3, -0.2, -1.0])
    z_m = (plane[2] / (camera.directions() @ plane)).astype(np.float32)
    mask = np.zeros(z_m.shape, dtype=bool)
    mask[5:25, 6:30] = True
    points, normals, depths, _, slopes = describe_seen(
        np.where(mask, z_m, np.nan).astype(np.float32),
        mask,
        np.array([1.0]),
        np.array([500.0, 520.0, 19.5, 14.5]),
    )
    np.testing.assert_allclose(points, (z_m[..., None] * camera.directions())[mask], atol=1e-6)
    np.testing.assert_allclose(normals @ plane, 1.0, atol=1e-4)
    np.testing.assert_array_equal(slopes[mask], normals.astype(np.float32))
    assert np.isnan(depths[~mask]).all()


def test_surface_without_a_mask_is_all_that_returned() -> None:
    ranges_m, _ = crop(20, 16, 5)
    image = RangeImage(ranges_m, Pinhole(50.0, 50.0, 8.0, 10.0, 16, 20))
    surface = object_surface(image)
    np.testing.assert_array_equal(surface.kinds == OBJECT, np.isfinite(ranges_m))
    with pytest.raises(ValueError, match="read-only"):
        surface.depths[0, 0] = 1.0
