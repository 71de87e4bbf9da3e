"""The shapes and the ground plan of the simulated town, against volumes and grids of points."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from depthprint.simulation.buildings import STYLES, building
from depthprint.simulation.cars import CAR_MODELS, car_body
from depthprint.simulation.footprints import Footprint, GroundPlan
from depthprint.simulation.meshes import box, ellipsoid, gable_roof, hexahedron, lathe, moved
from depthprint.simulation.sensor_noise import _seen_by_both


def volume(triangles: np.ndarray) -> float:
    a, b, c = np.moveaxis(triangles.astype(float), 1, 0)
    return float(np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (box(1, 3, 2, 5, 1, 2), 6.0),
        (hexahedron((-1, 1, -1, 1), (0, 0, 0, 0), 0, 3), 4.0),
        (gable_roof(4, 2, 3, 1, overhang=0.0), 4.0),
        (moved(box(1, 3, 2, 5, 1, 2), 4, -7, 1.0, 2.0), 6.0),
        (lathe([(0, 0), (1, 0), (1, 2), (0, 2)], sides=400), 2 * math.pi),
    ],
    ids=["box", "pyramid", "roof", "moved", "cylinder"],
)
def test_solids_are_closed_and_have_their_volume(shape: np.ndarray, expected: float) -> None:
    assert volume(shape) == pytest.approx(expected, rel=1e-3)


def test_ellipsoids_reach_their_poles_and_stay_within_their_radii() -> None:
    points = ellipsoid((2, 2, 3), (1, 0, 5), sides=12).reshape(-1, 3)
    np.testing.assert_allclose([points[:, 2].min(), points[:, 2].max()], [2, 8], atol=1e-5)
    assert np.hypot(points[:, 0] - 1, points[:, 1]).max() <= 2 + 1e-5


@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES.keys())
def test_buildings_stay_on_their_plot(style) -> None:
    for seed in range(40):
        rng = np.random.default_rng(seed)
        width = rng.uniform(4.5, 45)
        shape = building(style, width, 10.0, 6.0, rng)
        low, high = shape.min(axis=(0, 1)), shape.max(axis=(0, 1))
        assert abs(low[0]) <= width / 2 + 1.0
        assert high[0] <= width / 2 + 1.0
        assert low[1] >= -10.5
        assert high[1] <= 1.3 + 1e-6
        assert low[2] == 0
        assert 6.0 <= high[2] < 6 + 10


@pytest.mark.parametrize("model", CAR_MODELS, ids=lambda m: m.name)
def test_car_bodies_have_the_size_of_their_model(model) -> None:
    shape = car_body(model)
    size = np.ptp(shape.reshape(-1, 3), axis=0)
    np.testing.assert_allclose(size, [model.length, model.width, model.height], atol=0.02)
    assert shape[..., 2].min() == 0


rectangles = st.builds(
    Footprint,
    st.floats(-12, 12),
    st.floats(-12, 12),
    st.floats(-4, 4),
    st.floats(0.3, 9),
    st.floats(0.3, 9),
)


def grid_inside(footprint: Footprint) -> np.ndarray:
    u, v = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 60))
    along, across = u.ravel() * footprint.half_length, v.ravel() * footprint.half_width
    c, s = math.cos(footprint.heading_rad), math.sin(footprint.heading_rad)
    return np.stack([footprint.x + along * c - across * s, footprint.y + along * s + across * c], axis=1)


def holds(footprint: Footprint, points: np.ndarray, slack_m: float) -> np.ndarray:
    c, s = math.cos(footprint.heading_rad), math.sin(footprint.heading_rad)
    offset = points - (footprint.x, footprint.y)
    along, across = offset @ (c, s), offset @ (-s, c)
    return (abs(along) <= footprint.half_length + slack_m) & (abs(across) <= footprint.half_width + slack_m)


@settings(max_examples=150, deadline=None)
@given(rectangles, rectangles)
def test_overlap_agrees_with_a_grid_of_points(first: Footprint, second: Footprint) -> None:
    plan = GroundPlan(np.array([[1000.0, 1000.0]]))
    plan.add(first)
    grid = grid_inside(second)
    if holds(first, grid, -1e-6).any():
        assert plan.overlaps(second)
    # A grid point lies within 0.31 m of every point of a rectangle of this size.
    if not holds(first, grid, 0.31).any():
        assert not plan.overlaps(second)


@settings(max_examples=100, deadline=None)
@given(rectangles, st.floats(-15, 15), st.floats(-15, 15))
def test_lane_clearance_is_the_distance_to_the_rectangle(footprint: Footprint, x: float, y: float) -> None:
    plan = GroundPlan(np.array([[x, y]]))
    measured = plan.lane_clearance(footprint, 60.0)
    by_grid = np.hypot(*(grid_inside(footprint) - (x, y)).T).min()
    assert measured <= by_grid + 1e-9
    assert measured >= by_grid - 0.31


def seen_by_both_slowly(disparity: np.ndarray) -> np.ndarray:
    seen = np.zeros(disparity.shape, dtype=bool)
    for row, column in np.ndindex(disparity.shape):
        landing = column - disparity[row, column]
        if not np.isfinite(landing):
            seen[row, column] = True
            continue
        others = [k - disparity[row, k] for k in range(column + 1, disparity.shape[1])]
        seen[row, column] = landing >= 0 and not any(other < landing for other in others)
    return seen


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(float, (3, 12), elements=st.one_of(st.floats(0, 9, width=32), st.just(math.nan))))
def test_hidden_pixels_agree_with_a_slow_reference(disparity: np.ndarray) -> None:
    finite = np.isfinite(disparity)
    np.testing.assert_array_equal(_seen_by_both(disparity)[finite], seen_by_both_slowly(disparity)[finite])
