"""What each point of a view counts: large flat surfaces are alike everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.verification.agreement import view_agreement
from depthprint.verification.depth_view import make_depth_view
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
    weights = surface_weights(view.counted, view.ranges_m, view.projection)
    assert (weights > 0).all()
    each = weights / np.linalg.norm(view.counted, axis=1)
    pole = view.counted[:, 0] < 0
    assert each[pole].min() > 3 * np.median(each[~pole])
    np.testing.assert_array_equal(view.weights, weights)


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
