"""What each point of a view counts: large flat surfaces are alike everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.projection import LaserRow, Pinhole
from depthprint.range_image import RangeImage
from depthprint.verification.agreement import view_agreement
from depthprint.verification.depth_view import make_depth_view
from depthprint.verification.surface import pixels_of, surface_at
from depthprint.verification.surface_weights import surface_weights

CAMERA = Pinhole(100.0, 100.0, 79.5, 39.5, 160, 80)


def street(pole_column: int | None) -> RangeImage:
    """A wall 6 m to the right that runs ahead, seen to 40 m, and a pole 10 m ahead."""
    columns = np.arange(160) - CAMERA.cx
    depth = np.where(columns > 0, 6.0 * CAMERA.fx / np.maximum(columns, 1e-9), np.inf)
    depth = np.where(depth < 40.0, depth, np.nan)
    image = np.tile(depth.astype(np.float32), (80, 1))
    if pole_column is not None:
        image[:, pole_column : pole_column + 2] = 10.0
    return RangeImage(image, CAMERA, sensor_height_m=1.6)


def test_points_of_a_pole_count_more_than_those_of_a_long_wall_at_their_range():
    view = make_depth_view(street(40))
    weights = view.weights
    assert (weights > 0).all()
    each = weights / np.linalg.norm(view.counted, axis=1)
    pole = view.counted[:, 0] < 0
    assert each[pole].min() > 3 * np.median(each[~pole])
    there, normals = surface_at(
        pixels_of(view.counted, view.ranges_m, view.projection), view.ranges_m, view.projection
    )
    alone = surface_weights(view.counted, there, normals, view.projection)
    np.testing.assert_array_equal(alone, weights)


def test_far_points_of_one_surface_count_more_than_near_ones():
    view = make_depth_view(street(None))
    ranges_m = np.linalg.norm(view.counted, axis=1)
    near, far = ranges_m < 12, ranges_m > 25
    assert np.median(view.weights[far]) > 1.5 * np.median(view.weights[near])


def test_a_missing_pole_costs_more_agreement_by_weights_than_by_count():
    with_pole, without = make_depth_view(street(40)), make_depth_view(street(None))
    alike = view_agreement(with_pole.counted, without, np.eye(4)).likeness
    weighed = view_agreement(with_pole.counted, without, np.eye(4), with_pole.weights).likeness
    assert 1 - weighed > 2 * (1 - alike)
    same = view_agreement(with_pole.counted, with_pole, np.eye(4), with_pole.weights)
    assert same.likeness == pytest.approx(1.0)


def corridor_scan() -> RangeImage:
    """A planar scan along a corridor 2 m wide that ends 8 m ahead, a door frame 0.3 m proud of its left wall."""
    row = LaserRow(180, -np.pi / 2 + np.pi / 360, np.pi / 180)
    bearings = row.angle_min_rad + row.angle_step_rad * np.arange(row.width)
    sides = 1.0 / np.maximum(np.abs(np.sin(bearings)), 1e-9)
    ranges_m = np.minimum(sides, 8.0 / np.maximum(np.cos(bearings), 1e-9))
    frame = (np.abs(bearings - np.radians(14)) < np.radians(1.2)) & (bearings > 0)
    ranges_m = np.where(frame, 0.7 / np.maximum(np.sin(bearings), 1e-9), ranges_m)
    return RangeImage(ranges_m[None].astype(np.float32), row)


def test_walls_of_a_planar_scan_count_less_a_point_than_what_stands_out():
    view = make_depth_view(corridor_scan())
    each = view.weights / np.linalg.norm(view.counted, axis=1)
    x, y = view.counted[:, 0], np.abs(view.counted[:, 1])
    walls = (np.abs(y - 1.0) < 0.01) & (x < 5.0)
    stands_out = np.abs(y - 0.7) < 0.01
    assert walls.sum() > 100
    assert stands_out.sum() >= 2
    assert np.median(each[stands_out]) > 2 * np.median(each[walls])


def test_a_planar_scan_of_a_corridor_moved_along_it_agrees_less_by_weights_than_by_count():
    view = make_depth_view(corridor_scan())
    moved = np.eye(4)
    moved[0, 3] = 2.0
    alike = view_agreement(view.counted, view, moved).likeness
    assert view_agreement(view.counted, view, moved, view.weights).likeness < alike - 0.3
