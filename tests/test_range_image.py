"""RangeImage: what it accepts, what it turns into NaN, and images made from points."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.errors import DataError, SettingsError
from depthprint.projection import LaserRow, Pinhole, Projection, Spherical
from depthprint.range_image import RangeImage

CAMERA = Pinhole(fx=40.0, fy=40.0, cx=7.5, cy=5.5, width=16, height=12)
LIDAR = Spherical(width=24, height=6, elevation_min_rad=-0.5, elevation_max_rad=0.5)
ROW = LaserRow(60, -math.pi / 2, math.pi / 60)


def image_of(projection: Projection, seed: int = 0) -> RangeImage:
    ranges = np.random.default_rng(seed).uniform(1, 9, (projection.height, projection.width))
    return RangeImage(ranges, projection, stamp_s=1.5, source="frame 7")


def test_ranges_are_a_read_only_float32_copy() -> None:
    given_m = np.full((12, 16), 2.0)
    image = RangeImage(given_m, CAMERA)
    given_m[:] = 5.0
    assert image.ranges_m.dtype == np.float32
    assert (image.ranges_m == 2.0).all()
    with pytest.raises(ValueError, match="read-only"):
        image.ranges_m[0, 0] = 1.0


def test_what_is_not_a_positive_finite_range_becomes_nan() -> None:
    ranges = np.ones((12, 16))
    ranges[0, :5] = [0.0, -3.0, np.inf, np.nan, 1e300]
    image = RangeImage(ranges, CAMERA)
    assert np.isnan(image.ranges_m[0, :5]).all()
    assert not image.valid[0, :5].any()
    assert image.valid.sum() == 12 * 16 - 5


def test_an_image_without_returns_is_named_when_returns_are_required() -> None:
    empty = RangeImage(np.zeros((12, 16)), CAMERA, source="frame-000004.depth.png")
    with pytest.raises(DataError, match=r"frame-000004\.depth\.png: expected at least one return"):
        empty.require_returns()
    some = image_of(CAMERA)
    assert some.require_returns() is some


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ranges_m": np.ones((16, 12))}, r"frame 7: expected ranges_m of shape \(12, 16\)"),
        ({"ranges_m": np.ones((12, 16, 1))}, r"got \(12, 16, 1\)"),
        ({"ranges_m": np.ones((12, 16), dtype=complex)}, "dtype complex128"),
        ({"ranges_m": np.ones((12, 16), dtype=bool)}, "dtype bool"),
        ({"mask": np.ones((12, 15), dtype=bool)}, "expected a bool mask"),
        ({"mask": np.ones((12, 16))}, "expected a bool mask"),
        ({"stamp_s": math.nan}, "finite stamp_s"),
        ({"sensor_height_m": -0.5}, "sensor_height_m"),
        ({"sensor_height_m": math.inf}, "sensor_height_m"),
        ({"projection": "pinhole"}, "projection, got str"),
        ({"depth": 1}, r"got \['depth'\]"),
    ],
)
def test_parts_that_do_not_fit_are_refused(changes: dict, message: str) -> None:
    with pytest.raises(DataError, match=message):
        image_of(CAMERA).replace(**changes)


def test_replace_keeps_the_other_fields() -> None:
    mask = np.zeros((12, 16), dtype=bool)
    image = image_of(CAMERA).replace(mask=mask, sensor_height_m=1.2)
    later = image.replace(stamp_s=9.0)
    assert (later.stamp_s, later.sensor_height_m, later.source) == (9.0, 1.2, "frame 7")
    np.testing.assert_array_equal(later.ranges_m, image.ranges_m)
    assert later.mask is not None
    assert not later.mask.flags.writeable


def test_points_flu_are_the_sensor_points_turned() -> None:
    for projection in (CAMERA, LIDAR, ROW):
        image = image_of(projection)
        turned = image.points().reshape(-1, 3) @ projection.R_flu_sensor.T
        np.testing.assert_allclose(image.points_flu().reshape(-1, 3), turned, atol=1e-6)


def test_a_crop_has_the_points_of_its_window() -> None:
    mask = np.zeros((12, 16), dtype=bool)
    mask[5, 6] = True
    image = image_of(CAMERA).replace(mask=mask)
    crop = image.cropped(left=4, top=3, width=6, height=5)
    np.testing.assert_allclose(crop.points(), image.points()[3:8, 4:10], atol=1e-6)
    assert crop.mask is not None
    assert crop.mask[2, 2]
    assert crop.mask.sum() == 1
    with pytest.raises(DataError, match="only pinhole images"):
        image_of(LIDAR).cropped(0, 0, 3, 3)
    with pytest.raises(SettingsError, match="window inside"):
        image.cropped(0, 0, 17, 3)


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([CAMERA, LIDAR, ROW]), st.integers(0, 2**32 - 1))
def test_an_image_survives_the_way_through_its_points(projection: Projection, seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = image_of(projection, seed)
    holes = rng.random(image.shape) < 0.3
    image = image.replace(ranges_m=np.where(holes, np.nan, image.ranges_m))
    points = image.points().reshape(-1, 3)
    again = RangeImage.from_points(rng.permutation(points), projection)
    np.testing.assert_allclose(again.ranges_m, image.ranges_m, rtol=1e-5)


def slow_z_buffer(points: np.ndarray, projection: Projection) -> np.ndarray:
    u, v, r = projection.project(points)
    out = np.full((projection.height, projection.width), np.inf)
    keep = np.isfinite(u) & np.isfinite(v) & np.isfinite(r) & (r > 0)
    columns, rows = np.floor(u[keep] + 0.5).astype(int), np.floor(v[keep] + 0.5).astype(int)
    inside = (columns >= 0) & (columns < projection.width) & (rows >= 0) & (rows < projection.height)
    np.minimum.at(out, (rows[inside], columns[inside]), r[keep][inside])
    return np.where(np.isinf(out), np.nan, out).astype(np.float32)


@pytest.mark.parametrize("projection", [CAMERA, LIDAR, ROW])
def test_each_pixel_keeps_its_nearest_return(projection: Projection) -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(0, 4, (5000, 3)) * [1, 1, 0.02 if projection is ROW else 1]
    points[::50] = np.nan
    points[::77] = 0.0
    points[::91] = np.inf
    image = RangeImage.from_points(points, projection, source="cloud")
    expected = slow_z_buffer(points, projection)
    assert np.isfinite(expected).any()
    np.testing.assert_array_equal(image.ranges_m, expected)
    assert image.source == "cloud"


def test_no_points_give_an_image_without_returns() -> None:
    image = RangeImage.from_points(np.empty((0, 3)), LIDAR)
    assert image.shape == (6, 24)
    assert not image.valid.any()
    with pytest.raises(DataError, match=r"points of shape \(n, 3\)"):
        RangeImage.from_points(np.ones((4, 2)), LIDAR)


def test_images_compare_by_identity() -> None:
    image = image_of(CAMERA)
    assert image == image
    assert image != image_of(CAMERA)
    assert len({image, image}) == 1
