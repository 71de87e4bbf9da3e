"""Starts of planar alignments: branch and bound against all offsets and turns, neighbours against all points."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from depthprint._kernels.scan_correlation import best_correlations
from depthprint._kernels.scan_icp import scan_residual
from depthprint.projection import LaserRow
from depthprint.range_image import RangeImage
from depthprint.verification.depth_view import DepthView, make_depth_view
from depthprint.verification.scan_starts import _FINE, _nearness, correlated_starts, correlation_shares
from depthprint.verification.verifier import GeometricVerifier

CELL_M, SIZE = 0.1, 128
HALF_TURN = LaserRow(181, -math.pi / 2, math.radians(1.0))


def corridor_scan(x_m: float, y_m: float, yaw_rad: float, projection: LaserRow = HALF_TURN) -> DepthView:
    """Simulated: a corridor 2.4 m wide along x, closed at 14 m, with door niches at odd distances on both sides."""
    walls = [((-30.0, 1.2), (14.0, 1.2)), ((-30.0, -1.2), (14.0, -1.2)), ((14.0, -1.2), (14.0, 1.2))]
    for begin, side in ((2.0, 1.0), (4.7, -1.0), (7.1, 1.0), (9.9, 1.0), (10.6, -1.0)):
        # a pillar: its front and its near side
        inner = side * 0.85
        walls += [((begin, inner), (begin + 0.4, inner)), ((begin, inner), (begin, side * 1.2))]
    bearings = projection.angle_min_rad + projection.angle_step_rad * np.arange(projection.width) + yaw_rad
    ranges = np.full(projection.width, np.inf)
    for (ax, ay), (bx, by) in walls:
        ux, uy = np.cos(bearings), np.sin(bearings)
        ex, ey = bx - ax, by - ay
        across = ux * ey - uy * ex
        with np.errstate(divide="ignore", invalid="ignore"):
            r = ((ax - x_m) * ey - (ay - y_m) * ex) / across
            s = ((ax - x_m) * uy - (ay - y_m) * ux) / across
        hit = (r > 0.05) & (s >= 0) & (s <= 1)
        ranges = np.where(hit, np.minimum(ranges, r), ranges)
    noise_m = 0.01 * np.random.default_rng(2).standard_normal(projection.width)
    ranges_m = np.where(ranges < 40, ranges + noise_m, np.nan).astype(np.float32)
    return make_depth_view(RangeImage(ranges_m[None], projection))


def planar_pose(x_m: float, y_m: float, yaw_rad: float) -> np.ndarray:
    T = np.eye(4)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    T[:2, :2] = (c, -s), (s, c)
    T[:2, 3] = x_m, y_m
    return T


def random_fields(rng: np.random.Generator) -> np.ndarray:
    cells = np.where(rng.random((SIZE, SIZE)) < 0.1, rng.integers(1, 256, (SIZE, SIZE)), 0).astype(np.uint8)
    fields = [cells]
    for width in (1, 2, 4):
        padded = np.pad(fields[-1], (0, width))
        parts = [padded[b : b + SIZE, a : a + SIZE] for b in (0, width) for a in (0, width)]
        fields.append(np.maximum.reduce(parts))
    return np.stack(fields)


def sum_under(
    points: np.ndarray, weights: np.ndarray, cells: np.ndarray, column: int, row: int, yaw: float
) -> int:
    c, s = math.cos(yaw), math.sin(yaw)
    x = np.floor((c * points[:, 0] - s * points[:, 1]) / CELL_M).astype(int) + SIZE // 2 + column
    y = np.floor((s * points[:, 0] + c * points[:, 1]) / CELL_M).astype(int) + SIZE // 2 + row
    return int(weights @ cells[y, x].astype(int))


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000), ahead=st.integers(0, 11), aside=st.integers(0, 9))
def test_branch_and_bound_finds_the_best_of_all_offsets_and_turns(seed, ahead, aside):
    rng = np.random.default_rng(seed)
    fields, points = random_fields(rng), rng.uniform(-3.0, 3.0, (30, 2))
    weights = rng.integers(1, 40, 30)
    yaws = np.array([-0.1, 0.0, 0.1])
    poses = np.empty((3, 3))
    most = np.empty(3, dtype=np.int64)
    found = best_correlations(points, weights, fields, CELL_M, yaws, ahead, aside, 3, 0.05, 0.0, poses, most)
    sums = {
        (column, row, yaw): sum_under(points, weights, fields[0], column, row, yaw)
        for yaw in yaws
        for row in range(-aside, aside + 1)
        for column in range(-ahead, ahead + 1)
    }
    left = dict(sums)
    for (x, y, yaw), total in zip(poses[:found], most, strict=False):
        column, row = round(x / CELL_M), round(y / CELL_M)
        assert left[column, row, yaw] == max(left.values()) == total
        left = {
            key: value
            for key, value in left.items()
            if abs(key[0] - column) > 3 or abs(key[1] - row) > 3 or abs(key[2] - yaw) > 0.05
        }
    assert found == 3 or not any(left.values())


def test_poses_that_correlate_far_less_than_the_best_are_left_out():
    rng = np.random.default_rng(1)
    points = rng.uniform(-3.0, 3.0, (30, 2))
    cells = np.zeros((SIZE, SIZE), dtype=np.uint8)
    columns, rows = (np.floor(points / CELL_M).astype(int) + SIZE // 2).T
    cells[rows, columns] = 255
    fields = np.stack([cells])
    poses, most, ones = np.empty((4, 3)), np.empty(4, dtype=np.int64), np.ones(30, dtype=np.int64)
    found = best_correlations(points, ones, fields, CELL_M, np.zeros(1), 8, 8, 0, 0.0, 0.9, poses, most)
    assert found == 1
    assert poses[0].tolist() == [0.0, 0.0, 0.0]
    assert most[0] == 30 * 255


def test_nearness_is_greatest_over_windows_that_double():
    fields = _nearness(corridor_scan(0.0, 0.0, 0.0), _FINE, 512).astype(int)
    assert fields[0].max() >= 200
    rng = np.random.default_rng(3)
    for level, width in enumerate((1, 2, 4, 8)):
        for b, a in rng.integers(150, 350, (200, 2)):
            assert fields[level, b, a] == fields[0, b : b + width, a : a + width].max()


@pytest.mark.parametrize(("x_m", "y_m", "turn_deg"), [(2.3, 0.2, 17.0), (-1.9, -0.3, -14.0), (0.4, 0.3, 3.0)])
def test_a_scan_further_along_a_corridor_is_started_from_where_it_was_taken(x_m, y_m, turn_deg):
    match, query = corridor_scan(0.0, 0.0, 0.0), corridor_scan(x_m, y_m, math.radians(turn_deg))
    starts = correlated_starts(query, match, 0.0)
    off = np.linalg.inv(planar_pose(x_m, y_m, math.radians(turn_deg))) @ starts[0]
    assert np.hypot(*off[:2, 3]) < 0.15
    assert abs(math.atan2(off[1, 0], off[0, 0])) < math.radians(2.0)
    found = GeometricVerifier().verify(query, match)
    assert found.accepted, found.reason
    assert np.hypot(*(found.T_match_query[:2, 3] - (x_m, y_m))) < 0.1


def test_the_place_that_a_scan_was_taken_at_correlates_most():
    query = corridor_scan(2.3, 0.2, math.radians(17.0))
    places = [
        corridor_scan(x, 0.0, math.radians(turn)) for x, turn in ((-12.0, 0.0), (2.0, 0.0), (6.5, 180.0))
    ]
    shares = correlation_shares(query, places, [0.0] * 3)
    assert shares.argmax() == 1
    assert ((shares > 0.0) & (shares < 1.0)).all()
    assert correlation_shares(query, [query], [0.0])[0] > 0.9
    assert correlation_shares(query, [], []).shape == (0,)
    # A turn that is not tried is not found, and one that is told is.
    around = LaserRow(360, -math.pi, math.radians(1.0))
    turned, place = corridor_scan(1.1, 0.2, math.radians(160.0), around), corridor_scan(0.0, 0.0, 0.0, around)
    told, untold, unknown = correlation_shares(turned, [place] * 3, [math.radians(150.0), 0.0, None])
    assert told > untold
    assert unknown >= told


def test_any_turn_is_found_where_it_is_not_known():
    around = LaserRow(360, -math.pi, math.radians(1.0))
    match = corridor_scan(0.0, 0.0, 0.0, around)
    query = corridor_scan(1.1, 0.2, math.radians(160.0), around)
    start = correlated_starts(query, match, None)[0]
    off = np.linalg.inv(planar_pose(1.1, 0.2, math.radians(160.0))) @ start
    assert np.hypot(*off[:2, 3]) < 0.15
    assert abs(math.atan2(off[1, 0], off[0, 0])) < math.radians(2.0)


def test_starts_are_no_more_than_are_refined_and_none_beside_another():
    match, query = corridor_scan(0.0, 0.0, 0.0), corridor_scan(2.3, 0.2, 0.3)
    match = replace(match, settings=replace(match.settings, refined_starts=3))
    starts = correlated_starts(query, match, 0.0)
    assert 1 <= len(starts) <= 3
    for k, T in enumerate(starts):
        for other in starts[:k]:
            turn = abs(math.atan2(T[1, 0], T[0, 0]) - math.atan2(other[1, 0], other[0, 0]))
            assert np.abs(T[:2, 3] - other[:2, 3]).max() > 0.5 or turn > math.radians(6.0)


def test_a_scan_of_far_walls_alone_is_refused_without_a_start():
    ranges_m = np.full((1, 181), 40.0, dtype=np.float32)
    far = make_depth_view(RangeImage(ranges_m, HALF_TURN))
    assert correlated_starts(far, far, 0.0).shape == (0, 4, 4)
    found = GeometricVerifier().verify(far, far)
    assert not found.accepted
    assert "no start" in found.reason


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 10_000),
    kind=st.sampled_from(["half", "full", "shuffled"]),
    limit_m=st.floats(0.05, 3.0),
    spacing=st.sampled_from([0.0, 0.03, 0.2]),
)
def test_partners_are_those_of_a_search_among_all_points(seed, kind, limit_m, spacing):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    begin, turn = rng.uniform(-math.pi, math.pi), math.pi if kind == "half" else 2 * math.pi - 1e-3
    bearings = begin + np.sort(rng.uniform(0.0, turn, n))
    if kind == "shuffled":
        rng.shuffle(bearings)
    target = rng.uniform(0.2, 8.0, n)[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    source = rng.uniform(-8.0, 8.0, (50, 2))
    paired, total = scan_residual(source, target, np.zeros(3), limit_m, spacing)
    apart, _ = cKDTree(target).query(source)
    near = apart[apart < limit_m + spacing * np.linalg.norm(source, axis=1)]
    assert paired == len(near)
    assert total == pytest.approx(float((near**2).sum()), rel=1e-9, abs=1e-12)
