"""The bird's-eye view."""

import numpy as np
import pytest

from depthprint.errors import SettingsError
from depthprint.polar_view import _grid_of_points, _grid_of_rays, polar_view
from depthprint.projection import LaserRow, Pinhole, Spherical
from depthprint.range_image import RangeImage
from depthprint.settings import PolarSettings
from synthetic import boxes, scan

FULL = PolarSettings(sectors=36, rings=20, ring_m=1.0, full_circle=True, smoothing=0.0)


def tower(azimuth_deg: float, range_m: float, height_m: float) -> RangeImage:
    """A 360 degree sensor 1 m above the ground that sees one thin tower and nothing else."""
    lidar = Spherical(360, 60, elevation_min_rad=-0.6, elevation_max_rad=0.6)
    ranges = np.full((60, 360), np.nan, np.float32)
    column = round((180 - azimuth_deg) - 0.5) % 360
    elevations = np.linspace(0.6, -0.6, 60)
    rows = 1.0 + range_m * np.tan(elevations)
    seen = (rows > 0.5) & (rows < height_m)
    ranges[seen, column] = range_m / np.cos(elevations[seen])
    return RangeImage(ranges, lidar, sensor_height_m=1.0)


@pytest.mark.parametrize("azimuth", [-175, -90, 0, 30, 120])
def test_a_tower_appears_in_its_own_cell_with_its_height(azimuth):
    grid = polar_view(tower(azimuth, 7.5, 3.0), FULL, ("height",))[0]
    ring, sector = np.unravel_index(grid.argmax(), grid.shape)
    assert ring == 7
    assert sector == int((180 - azimuth) // 10) % 36
    assert grid.max() == pytest.approx(3.0 / FULL.max_height_m, abs=0.06)
    assert np.count_nonzero(grid) == 1


def test_turning_the_sensor_rolls_the_sectors():
    first = polar_view(tower(40, 7.5, 3.0), FULL, ("height", "count"))
    turned = polar_view(tower(10, 7.5, 3.0), FULL, ("height", "count"))
    assert np.allclose(np.roll(first, 3, axis=2), turned, atol=1e-6)


def test_the_ground_is_not_counted():
    grid = polar_view(tower(0, 7.5, 0.3), FULL, ("height", "count"))
    assert not grid.any()


def test_line_direction_of_a_wall_ahead_is_across():
    lidar = LaserRow(180, -np.pi / 2, np.pi / 180)
    angles = lidar.angle_min_rad + np.arange(180) * lidar.angle_step_rad
    ranges = np.where(np.abs(angles) < 0.9, 5.0 / np.cos(angles), np.nan)
    image = RangeImage(ranges[None].astype(np.float32), lidar)
    settings = PolarSettings(sectors=12, rings=20, ring_m=0.5, smoothing=0.0)
    cosine, sine = polar_view(image, settings, ("line-cos", "line-sin"))
    assert cosine.min() < -0.5
    assert cosine.max() <= 0
    assert np.abs(sine).max() < 0.1


def test_channels_come_in_the_order_asked_for():
    image = boxes(1)
    settings = PolarSettings()
    both = polar_view(image, settings, ("count", "height"))
    assert np.array_equal(both[0], polar_view(image, settings, ("count",))[0])
    assert np.array_equal(both[1], polar_view(image, settings, ("height",))[0])
    assert both.shape == (2, settings.rings, settings.sectors)


def test_unknown_channel_is_an_error_that_lists_the_known_ones():
    with pytest.raises(SettingsError, match="line-cos"):
        polar_view(scan(0), PolarSettings(), ("colour",))


@pytest.mark.parametrize("channel", ["height", "low-count", "high-count", "count"])
@pytest.mark.parametrize(
    "projection", [Pinhole(90.0, 90.0, 76.8, 46.3, 155, 94), Spherical(360, 32, elevation_max_rad=0.3)]
)
def test_fixed_cells_of_the_rays_give_what_the_points_give(projection, channel):
    rng = np.random.default_rng(7)
    ranges = rng.uniform(0.5, 60.0, (projection.height, projection.width)).astype(np.float32)
    ranges[rng.random(ranges.shape) < 0.2] = np.nan
    image = RangeImage(ranges, projection, sensor_height_m=1.6)
    for settings in (PolarSettings(), PolarSettings(sectors=60, full_circle=True, ring_growth=1.1)):
        by_rays = _grid_of_rays(image, settings, (channel,))
        by_points = _grid_of_points(image, settings, (channel,))
        assert by_points[0].any()
        np.testing.assert_allclose(by_rays, by_points, atol=1e-6)
