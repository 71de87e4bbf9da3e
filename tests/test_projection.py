"""Projections: pixels to points and back, sizes, crops, frames, and what they refuse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.errors import DataError, SettingsError
from depthprint.projection import LaserRow, Pinhole, Projection, Spherical

CAMERA = Pinhole(fx=60.0, fy=55.0, cx=20.3, cy=14.1, width=40, height=30)
LIDAR = Spherical(width=36, height=8)
SECTOR = Spherical(12, 6, math.radians(150), math.radians(250), -0.3, 0.4)
ROW = LaserRow(width=181, angle_min_rad=-math.pi / 2, angle_step_rad=math.radians(1.0))
REVERSED_ROW = LaserRow(width=90, angle_min_rad=1.0, angle_step_rad=-0.02)
ALL = [CAMERA, LIDAR, SECTOR, ROW, REVERSED_ROW]


def pinholes() -> st.SearchStrategy[Pinhole]:
    focal = st.floats(5, 500)
    return st.builds(
        Pinhole, focal, focal, st.floats(-30, 60), st.floats(-30, 60), st.integers(1, 24), st.integers(1, 24)
    )


def sphericals() -> st.SearchStrategy[Spherical]:
    def build(width: int, height: int, start: float, span: float, low: float, rise: float) -> Spherical:
        return Spherical(width, height, start, start + span, low, min(low + rise, 1.5))

    return st.builds(
        build,
        st.integers(1, 24),
        st.integers(1, 24),
        st.floats(-4, 4),
        st.one_of(st.just(2 * math.pi), st.floats(0.1, 6.2)),
        st.floats(-1.5, 1.0),
        st.floats(0.1, 1.5),
    )


def laser_rows() -> st.SearchStrategy[LaserRow]:
    def build(width: int, start: float, span: float, sign: int) -> LaserRow:
        return LaserRow(width, start, sign * span / width)

    return st.builds(
        build, st.integers(1, 60), st.floats(-4, 4), st.floats(0.1, 6.28), st.sampled_from([-1, 1])
    )


@settings(max_examples=150, deadline=None)
@given(st.one_of(pinholes(), sphericals(), laser_rows()), st.integers(0, 2**32 - 1))
def test_projecting_the_points_of_an_image_gives_back_its_pixels(projection: Projection, seed: int) -> None:
    ranges = np.random.default_rng(seed).uniform(0.5, 80, (projection.height, projection.width))
    u, v, r = projection.project(projection.points(ranges).reshape(-1, 3))
    columns, rows = np.meshgrid(np.arange(projection.width), np.arange(projection.height))
    np.testing.assert_allclose(u, columns.ravel(), atol=2e-3)
    np.testing.assert_allclose(v, rows.ravel(), atol=2e-3)
    np.testing.assert_allclose(r, ranges.ravel(), rtol=1e-5)


@pytest.mark.parametrize("projection", ALL)
def test_pixels_without_a_return_have_no_point(projection: Projection) -> None:
    ranges = np.full((projection.height, projection.width), 3.0)
    ranges[0, :4] = [np.nan, 0.0, -1.0, np.inf]
    points = projection.points(ranges)
    assert points.dtype == np.float32
    assert np.isnan(points[0, :4]).all()
    assert np.isfinite(points[0, 4:]).all()


def test_a_pinhole_pixel_holds_depth_and_a_spherical_one_the_range() -> None:
    assert np.allclose(CAMERA.points(np.full((30, 40), 2.0))[..., 2], 2.0)
    assert np.allclose(np.linalg.norm(LIDAR.points(np.full((8, 36), 2.0)), axis=-1), 2.0)


def test_frames_agree_once_turned_to_forward_left_up() -> None:
    # A point ahead, a little left and above: in each sensor's own frame.
    in_camera = np.array([-0.1, -0.2, 1.0])
    np.testing.assert_allclose(CAMERA.R_flu_sensor @ in_camera, [1.0, 0.1, 0.2])
    for projection in (LIDAR, ROW):
        np.testing.assert_array_equal(projection.R_flu_sensor, np.eye(3))
    for projection in ALL:
        R = projection.R_flu_sensor
        np.testing.assert_allclose(R @ R.T, np.eye(3))
        assert np.linalg.det(R) == pytest.approx(1.0)


def test_spherical_columns_run_from_left_to_right_and_rows_from_up_to_down() -> None:
    forward, left, up = np.eye(3)
    u, v, _ = LIDAR.project([forward, forward + 0.5 * left, forward + 0.02 * up, -forward])
    assert u[0] == pytest.approx(17.5)
    assert u[1] < u[0]
    assert v[2] < v[0]
    assert u[3] == pytest.approx(-0.5) or u[3] == pytest.approx(35.5)


def test_an_azimuth_beyond_pi_is_found_in_a_sector_that_crosses_it() -> None:
    azimuth = math.radians(-170)  # 190 degrees, inside the sector from 150 to 250
    u, _, _ = SECTOR.project([[math.cos(azimuth), math.sin(azimuth), 0.0]])
    assert u[0] == pytest.approx((250 - 190) / 100 * 12 - 0.5)


def test_a_full_circle_wraps_and_a_sector_does_not() -> None:
    assert LIDAR.wraps
    assert not SECTOR.wraps
    azimuth = np.linspace(-4 * math.pi, 4 * math.pi, 1001)
    u, _, _ = LIDAR.project(np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1))
    assert u.min() >= -0.5
    assert u.max() < 35.5


def test_points_behind_a_camera_and_at_the_centre_have_no_pixel() -> None:
    u, v, z = CAMERA.project([[0.1, 0.2, -1.0], [0.1, 0.0, 0.0], [np.nan, 0.0, 1.0]])
    assert np.isnan(u).all()
    assert np.isnan(v[:2]).all()
    assert z[0] == -1.0
    for projection in (LIDAR, ROW):
        u, v, r = projection.project(np.zeros((1, 3)))
        assert np.isnan([u[0], v[0]]).all()
        assert r[0] == 0


@pytest.mark.parametrize("projection", ALL)
def test_resizing_keeps_the_field_of_view_and_undoes_itself(projection: Projection) -> None:
    height = 1 if isinstance(projection, LaserRow) else 7
    other = projection.resized(13, height)
    assert (other.width, other.height) == (13, height)
    assert other.horizontal_fov_rad == pytest.approx(projection.horizontal_fov_rad)
    back = other.resized(projection.width, projection.height)
    np.testing.assert_allclose(back.directions(), projection.directions(), atol=1e-12)


@pytest.mark.parametrize("projection", [CAMERA, LIDAR, ROW])
def test_halving_puts_the_new_pixel_between_the_two_old_ones(projection: Projection) -> None:
    height = max(1, projection.height // 2)
    odd = projection.resized(projection.width - projection.width % 2, projection.height)
    half = odd.resized(odd.width // 2, height)
    u, _, _ = odd.project(half.directions().reshape(-1, 3) * 5)
    expected = np.tile(2 * np.arange(half.width) + 0.5, half.height)
    np.testing.assert_allclose(u, expected, atol=1e-9)


def test_a_crop_sees_the_same_rays() -> None:
    crop = CAMERA.cropped(left=5, top=3, width=10, height=8)
    np.testing.assert_allclose(crop.directions(), CAMERA.directions()[3:11, 5:15], atol=1e-15)
    for window in [(-1, 0, 5, 5), (0, 0, 41, 5), (35, 0, 6, 5), (0, 25, 5, 6)]:
        with pytest.raises(SettingsError, match="window inside 40 x 30"):
            CAMERA.cropped(*window)


def test_fields_of_view() -> None:
    assert Pinhole(50, 50, 49.5, 30, 100, 60).horizontal_fov_rad == pytest.approx(math.pi / 2)
    assert LIDAR.horizontal_fov_rad == pytest.approx(2 * math.pi)
    assert LaserRow(360, -math.pi / 2, math.pi / 360).horizontal_fov_rad == pytest.approx(math.pi)


def test_spinning_lidars_have_a_row_for_each_beam() -> None:
    def elevations_deg(projection: Spherical) -> np.ndarray:
        return np.degrees(np.arcsin(projection.directions()[:, 0, 2]))

    np.testing.assert_allclose(elevations_deg(Spherical.vlp16(90)), np.arange(15, -16, -2.0), atol=1e-9)
    beams = elevations_deg(Spherical.hdl32(90))
    assert beams[[0, -1]] == pytest.approx([10.667, -30.667], abs=1e-3)
    assert Spherical.hdl64(1024).height == 64
    assert all(s.wraps for s in (Spherical.vlp16(), Spherical.hdl32(), Spherical.hdl64()))


def test_directions_are_read_only() -> None:
    for projection in ALL:
        with pytest.raises(ValueError, match="read-only"):
            projection.directions()[0, 0, 0] = 1.0


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Pinhole(0, 1, 0, 0, 4, 4), "fx > 0"),
        (lambda: Pinhole(1, -1, 0, 0, 4, 4), "fy > 0"),
        (lambda: Pinhole(1, 1, math.nan, 0, 4, 4), "finite cx"),
        (lambda: Pinhole(1, math.inf, 0, 0, 4, 4), "finite fy"),
        (lambda: Pinhole("585", 1, 0, 0, 4, 4), "finite fx, got '585'"),
        (lambda: Pinhole(1, 1, 0, 0, 0, 4), "width of at least 1"),
        (lambda: Pinhole(1, 1, 0, 0, 4, 4.5), "whole height"),
        (lambda: Spherical(4, 0), "height of at least 1"),
        (lambda: Spherical(4, 4, 1.0, 1.0), "azimuth_min_rad < azimuth_max_rad"),
        (lambda: Spherical(4, 4, -4.0, 4.0), "at most a full circle"),
        (lambda: Spherical(4, 4, elevation_min_rad=0.3, elevation_max_rad=0.1), "elevation_min_rad"),
        (lambda: Spherical(4, 4, elevation_min_rad=-2.0), "elevation_min_rad"),
        (lambda: LaserRow(10, 0.0, 0.0), "other than zero"),
        (lambda: LaserRow(721, 0.0, math.radians(1)), "within one full turn"),
        (lambda: ROW.resized(10, 2), "height of 1"),
        (lambda: CAMERA.resized(0, 3), "width of at least 1"),
    ],
)
def test_impossible_projections_are_refused(build, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        build()


def test_arrays_of_another_shape_are_refused() -> None:
    with pytest.raises(DataError, match=r"expected ranges of shape \(30, 40\), got \(40, 30\)"):
        CAMERA.points(np.ones((40, 30)))
    for projection in ALL:
        with pytest.raises(DataError, match=r"points of shape \(n, 3\)"):
            projection.project(np.ones((3, 4)))
