"""Range thumbnails: pixels, shifts, and what the distance does not see."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.cascade.range_thumbnail import RangeThumbnails, range_thumbnail
from depthprint.errors import DataError
from depthprint.projection import Pinhole, Spherical
from depthprint.range_image import RangeImage
from synthetic import boxes, scan

seeds = st.integers(0, 2**31)


def thumbnail(seed: int, shape: tuple[int, int] = (12, 12)) -> np.ndarray:
    return np.random.default_rng(seed).uniform(1.0, 5.0, shape).astype(np.float32)


def distance(first: np.ndarray, second: np.ndarray, *, wraps: bool = False) -> float:
    places = RangeThumbnails(wraps=wraps)
    places.add(second)
    return float(places.distances(first)[0])


def slow_distance(first: np.ndarray, second: np.ndarray, down: int, across: int) -> float:
    """By the pixels that both show, shift by shift."""
    rows, columns = first.shape
    best = math.inf
    for y in range(-down, down + 1):
        for x in range(-across, across + 1):
            a = first[max(0, -y) : rows - max(0, y), max(0, -x) : columns - max(0, x)].astype(np.float64)
            b = second[max(0, y) : rows - max(0, -y), max(0, x) : columns - max(0, -x)].astype(np.float64)
            best = min(best, np.var(a - b) / (np.var(a) + np.var(b)))
    return math.sqrt(best)


@pytest.mark.parametrize(("shape", "reach"), [((12, 12), (2, 2)), ((1, 64), (0, 4))])
def test_distances_are_those_over_the_shared_pixels_at_the_best_shift(shape, reach):
    places = RangeThumbnails()
    stored = [thumbnail(seed, shape) for seed in range(5)]
    assert [places.add(one) for one in stored] == [0, 1, 2, 3, 4]
    query = thumbnail(9, shape)
    expected = [slow_distance(query, one, *reach) for one in stored]
    np.testing.assert_allclose(places.distances(query), expected, atol=1e-4)
    np.testing.assert_allclose(places.distances(query, 2), expected[:2], atol=1e-4)
    assert len(places.distances(query, 0)) == 0
    assert len(RangeThumbnails().distances(query)) == 0


@given(seeds, st.floats(-0.5, 20.0), st.integers(-2, 2), st.integers(-2, 2))
@settings(max_examples=25, deadline=None)
def test_a_step_back_and_a_small_turn_cost_nothing(seed, step_m, down, across):
    wide = thumbnail(seed, (16, 16))
    there = wide[2:14, 2:14]
    turned = wide[2 - down : 14 - down, 2 - across : 14 - across] + np.float32(step_m)
    assert distance(there, turned) == pytest.approx(0.0, abs=0.01)


@given(seeds, seeds)
@settings(max_examples=25, deadline=None)
def test_the_distance_is_symmetric_and_has_no_units(first, second):
    a, b = thumbnail(first), thumbnail(second)
    assert distance(a, b) == pytest.approx(distance(b, a), abs=1e-3)
    assert distance(a, b) == pytest.approx(distance(7 * a, 7 * b), abs=1e-3)


@pytest.mark.parametrize("columns", [10, 30, 50])
def test_columns_of_a_full_circle_shift_around(columns):
    ring = thumbnail(3, (2, 60))
    turned = np.roll(ring, columns, axis=1)
    assert distance(turned, ring, wraps=True) == pytest.approx(0.0, abs=1e-3)
    assert distance(turned, ring) > 0.5


def test_flat_walls_are_alike_and_not_a_division_by_nothing():
    near, far = np.full((12, 12), 1.0, np.float32), np.full((12, 12), 3.0, np.float32)
    assert distance(near, far) == pytest.approx(1.0)
    assert distance(near, near) == pytest.approx(1.0)


def test_thumbnails_have_the_shape_of_their_sensor_and_no_holes():
    assert range_thumbnail(boxes(1)).shape == (12, 12)
    assert range_thumbnail(scan(1)).shape == (1, 64)
    spinning = Spherical(
        width=120, height=8, azimuth_min_rad=-math.pi, azimuth_max_rad=math.pi,
        elevation_min_rad=-0.4, elevation_max_rad=0.1,
    )  # fmt: skip
    ranges = np.full((8, 120), 4.0, dtype=np.float32)
    ranges[:, 50:70] = np.nan
    found = range_thumbnail(RangeImage(ranges, spinning))
    assert found.shape == (2, 60)
    np.testing.assert_allclose(found, 4.0, rtol=1e-5)


def test_a_frame_without_a_return_and_another_sensor_s_thumbnail_are_refused():
    camera = Pinhole(fx=20.0, fy=20.0, cx=10.0, cy=8.0, width=20, height=16)
    empty = RangeImage(np.full((16, 20), np.nan, np.float32), camera, source="frame 7")
    with pytest.raises(DataError, match="frame 7"):
        range_thumbnail(empty)
    places = RangeThumbnails()
    places.add(thumbnail(1))
    for ask in (places.add, places.distances):
        with pytest.raises(DataError, match=r"\(12, 12\).*\(1, 64\)"):
            ask(thumbnail(2, (1, 64)))
    assert len(places) == 1
