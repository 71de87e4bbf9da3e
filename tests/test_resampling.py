"""Resampling: exact averages, holes stay holes, edges stay edges, and the projection follows."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.errors import DataError, SettingsError
from depthprint.projection import LaserRow, Pinhole, Spherical
from depthprint.range_image import RangeImage
from depthprint.resampling import fill_holes, resample


def pinhole_image(ranges: np.ndarray, **fields) -> RangeImage:
    height, width = ranges.shape
    return RangeImage(ranges, Pinhole(50.0, 50.0, width / 2, height / 2, width, height), **fields)


def smooth_ranges(height: int, width: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    a, b = rng.uniform(-0.01, 0.01, 2)
    return 3.0 + a * y + b * x + 0.02 * rng.standard_normal((height, width))


def slow_mean(ranges: np.ndarray, height: int, width: int) -> np.ndarray:
    """Average over the valid part of each footprint, overlap by overlap, for shrinking."""
    out = np.full((height, width), np.nan)
    sy, sx = ranges.shape[0] / height, ranges.shape[1] / width
    for i in range(height):
        for j in range(width):
            total = mass = 0.0
            for y in range(ranges.shape[0]):
                wy = min(y + 1, (i + 1) * sy) - max(y, i * sy)
                for x in range(ranges.shape[1]):
                    wx = min(x + 1, (j + 1) * sx) - max(x, j * sx)
                    if wy > 1e-9 and wx > 1e-9 and np.isfinite(ranges[y, x]):
                        total += wy * wx * ranges[y, x]
                        mass += wy * wx
            if mass > 0:
                out[i, j] = total / mass
    return out


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 14), st.integers(1, 14), st.data())
def test_shrinking_is_the_mean_of_the_valid_pixels_by_overlap(height: int, width: int, data) -> None:
    new_height, new_width = data.draw(st.integers(1, height)), data.draw(st.integers(1, width))
    seed = data.draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0.5, 20, (height, width)).astype(np.float32)
    ranges[rng.random((height, width)) < data.draw(st.sampled_from([0.0, 0.3, 0.9]))] = np.nan
    small = resample(pinhole_image(ranges), new_width, new_height, edge_ratio=math.inf)
    np.testing.assert_allclose(small.ranges_m, slow_mean(ranges, new_height, new_width), rtol=1e-6)


def test_without_holes_shrinking_agrees_with_opencv_area_averaging() -> None:
    ranges = smooth_ranges(48, 64).astype(np.float32)
    for width, height in [(32, 24), (16, 12), (24, 18), (60, 47)]:
        ours = resample(pinhole_image(ranges), width, height).ranges_m
        theirs = cv2.resize(ranges, (width, height), interpolation=cv2.INTER_AREA)
        np.testing.assert_allclose(ours, theirs, rtol=2e-6)


def test_without_holes_enlarging_agrees_with_opencv_linear_interpolation() -> None:
    ranges = smooth_ranges(11, 13).astype(np.float32)
    ours = resample(pinhole_image(ranges), 40, 27).ranges_m
    theirs = cv2.resize(ranges, (40, 27), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(ours, theirs, rtol=1e-5)


@pytest.mark.parametrize("method", ["mean", "median", "nearest"])
@pytest.mark.parametrize(("width", "height"), [(96, 96), (10, 7), (33, 96), (1, 1)])
def test_a_constant_with_holes_stays_exactly_that_constant(method: str, width: int, height: int) -> None:
    ranges = np.full((40, 60), 1.1, dtype=np.float32)
    ranges[np.random.default_rng(0).random((40, 60)) < 0.4] = np.nan
    out = resample(pinhole_image(ranges), width, height, method=method)
    assert out.valid.any()
    assert set(np.unique(out.ranges_m[out.valid])) == {np.float32(1.1)}


def test_a_hole_larger_than_the_footprint_stays_a_hole() -> None:
    ranges = np.full((480, 640), 2.0)
    ranges[100:200, 200:400] = np.nan
    out = resample(pinhole_image(ranges))
    assert out.shape == (96, 96)
    assert np.isnan(out.ranges_m[21:39, 31:59]).all()
    assert out.valid.mean() == pytest.approx(1 - 100 * 200 / (480 * 640), abs=0.01)


def test_a_footprint_with_too_few_valid_pixels_is_a_hole() -> None:
    ranges = np.full((4, 4), np.nan)
    ranges[0, 0] = ranges[0, 2:] = ranges[1, 2] = 5.0
    image = pinhole_image(ranges)
    np.testing.assert_array_equal(resample(image, 2, 2).valid, [[True, True], [False, False]])
    np.testing.assert_array_equal(
        resample(image, 2, 2, min_valid_share=0.5).valid, [[False, True], [False, False]]
    )


@pytest.mark.parametrize(("width", "height"), [(7, 5), (16, 9), (96, 96)])
def test_no_depth_appears_between_two_surfaces(width: int, height: int) -> None:
    rng = np.random.default_rng(1)
    ranges = np.where(rng.random((30, 40)) < 0.5, 1.0, 4.0)
    ranges[rng.random((30, 40)) < 0.1] = np.nan
    image = pinhole_image(ranges)
    kept = resample(image, width, height)
    assert set(np.unique(kept.ranges_m[kept.valid])) <= {1.0, 4.0}
    blended = resample(image, width, height, edge_ratio=math.inf).ranges_m
    assert ((blended > 1.2) & (blended < 3.8)).any()


def test_the_surface_that_covers_more_of_the_pixel_wins() -> None:
    ranges = np.array([[1.0, 1.02, 3.0], [3.1, 3.05, 9.0]])
    out = resample(pinhole_image(ranges), 1, 1)
    assert out.ranges_m[0, 0] == pytest.approx((3.0 + 3.1 + 3.05) / 3)


def test_a_slanted_surface_is_not_taken_for_an_edge() -> None:
    ranges = np.tile(1.05 ** np.arange(12), (12, 1))
    plain = resample(pinhole_image(ranges), 1, 1, edge_ratio=math.inf)
    np.testing.assert_array_equal(resample(pinhole_image(ranges), 1, 1).ranges_m, plain.ranges_m)


def test_large_footprints_take_the_same_surface_as_small_ones() -> None:
    rng = np.random.default_rng(5)
    ranges = np.where(rng.random((20, 20)) < 0.7, 2.0, 6.0)
    assert resample(pinhole_image(ranges), 1, 1).ranges_m[0, 0] == 2.0


def test_median_is_a_depth_that_was_measured() -> None:
    rng = np.random.default_rng(2)
    ranges = rng.uniform(1, 9, (15, 15)).astype(np.float32)
    ranges[rng.random((15, 15)) < 0.3] = np.nan
    out = resample(pinhole_image(ranges), 5, 5, method="median").ranges_m
    for i in range(5):
        for j in range(5):
            block = ranges[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
            block = np.sort(block[np.isfinite(block)])
            assert out[i, j] == block[(len(block) - 1) // 2]


def test_nearest_takes_the_pixel_under_the_centre() -> None:
    ranges = np.arange(1.0, 31.0).reshape(5, 6)
    ranges[2, 1] = np.nan
    out = resample(pinhole_image(ranges), 2, 1, method="nearest").ranges_m
    assert np.isnan(out[0, 0])
    assert out[0, 1] == ranges[2, 4]


def test_columns_of_a_full_circle_blend_over_the_seam() -> None:
    ranges = np.full((2, 8), 10.0)
    ranges[:, 0] = 10.4
    closed = resample(RangeImage(ranges, Spherical(8, 2)), 16, 2)
    assert closed.projection.wraps
    assert closed.ranges_m[0, 0] == pytest.approx(0.75 * 10.4 + 0.25 * 10.0)
    assert closed.ranges_m[0, 15] == pytest.approx(0.25 * 10.4 + 0.75 * 10.0)
    sector = resample(RangeImage(ranges, Spherical(8, 2, -1.0, 1.0)), 16, 2)
    assert sector.ranges_m[0, 0] == pytest.approx(10.4)
    assert sector.ranges_m[0, 15] == pytest.approx(10.0)


def test_a_plane_stays_in_place_when_its_image_is_resampled() -> None:
    camera = Pinhole(60.0, 60.0, 31.5, 23.5, 64, 48)
    rays = camera.directions()
    normal, distance = np.array([0.1, 0.3, 1.0]), 4.0
    image = RangeImage(distance / (rays @ normal), camera)
    for size in [(32, 24), (96, 96)]:
        points = resample(image, *size).points()[3:-3, 3:-3]
        np.testing.assert_allclose(points @ normal, distance, atol=5e-3)


def test_a_laser_row_stays_one_row() -> None:
    row = LaserRow(360, -math.pi / 2, math.pi / 360)
    out = resample(RangeImage(np.full((1, 360), 7.0), row), 90)
    assert out.shape == (1, 90)
    assert isinstance(out.projection, LaserRow)
    assert out.projection.angle_step_rad == pytest.approx(math.pi / 90)


def test_object_and_background_are_not_mixed() -> None:
    ranges = np.full((8, 8), 1.00)
    mask = np.zeros((8, 8), dtype=bool)
    mask[:, :3] = True
    ranges[mask] = 0.95
    out = resample(pinhole_image(ranges, mask=mask, source="a"), 4, 4)
    np.testing.assert_array_equal(out.mask, np.tile([True, True, False, False], (4, 1)))
    np.testing.assert_allclose(out.ranges_m, np.where(out.mask, 0.95, 1.0), rtol=1e-6)
    assert out.source == "a"
    nearest = resample(pinhole_image(ranges, mask=mask), 4, 4, method="nearest")
    np.testing.assert_array_equal(nearest.mask, np.tile([True, False, False, False], (4, 1)))


def test_the_size_that_is_there_already_changes_nothing() -> None:
    image = pinhole_image(smooth_ranges(96, 96))
    assert resample(image) is image


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "cubic"}, "method 'mean', 'median' or 'nearest', got 'cubic'"),
        ({"min_valid_share": 1.5}, r"min_valid_share in \[0, 1\]"),
        ({"edge_ratio": 0.0}, "edge_ratio > 0"),
        ({"edge_ratio": math.nan}, "edge_ratio > 0"),
        ({"width": 0}, "width of at least 1"),
    ],
)
def test_impossible_settings_are_refused(options: dict, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        resample(pinhole_image(smooth_ranges(6, 6)), **options)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 2**32 - 1), st.booleans())
def test_holes_are_filled_from_a_nearest_valid_pixel(height: int, width: int, seed: int, wraps: bool) -> None:
    rng = np.random.default_rng(seed)
    values = rng.uniform(1, 9, (height, width)).astype(np.float32)
    values[rng.random((height, width)) < 0.6] = np.nan
    values[rng.integers(height), rng.integers(width)] = 3.0
    filled = fill_holes(values, wraps=wraps)
    rows, columns = np.nonzero(np.isfinite(values))
    for i in range(height):
        for j in range(width):
            if np.isfinite(values[i, j]):
                assert filled[i, j] == values[i, j]
                continue
            across = np.abs(columns - j)
            if wraps:
                across = np.minimum(across, width - across)
            distance = (rows - i) ** 2 + across**2
            nearest = values[rows, columns][distance == distance.min()]
            assert filled[i, j] in nearest


def test_filling_needs_one_valid_pixel() -> None:
    with pytest.raises(DataError, match="at least one valid pixel"):
        fill_holes(np.full((3, 3), np.nan))
    with pytest.raises(DataError, match="2-D"):
        fill_holes(np.ones(4))
