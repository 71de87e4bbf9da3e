"""The geometric check: poses of known views recovered, different places refused, counts against a slow reference."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.errors import DataError, MissingExtraError, SettingsError
from depthprint.projection import LaserRow, Pinhole, Projection, Spherical
from depthprint.range_image import RangeImage
from depthprint.simulation import meshes
from depthprint.simulation.meshes import merge
from depthprint.simulation.ray_casting import RayScene
from depthprint.verification import (
    GeometricVerifier,
    VerificationSettings,
    make_depth_view,
    settings_for,
    view_agreement,
)
from depthprint.verification.verifier import judged

STEREO = Pinhole(fx=90.0, fy=90.0, cx=77.0, cy=46.0, width=155, height=94)
HAND_HELD = Pinhole(fx=143.95, fy=143.95, cx=79.5, cy=59.5, width=160, height=120)
SPINNING = Spherical(width=360, height=32)
ROW = LaserRow(360, -math.pi / 2, math.pi / 360)
SENSORS = {"street": (STEREO, 1.6), "lidar": (SPINNING, 1.6), "laser": (ROW, 0.5)}


def box(centre: tuple[float, float, float], sizes: tuple[float, float, float]):
    low, high = np.subtract(centre, np.array(sizes) / 2), np.add(centre, np.array(sizes) / 2)
    return meshes.box(low[0], high[0], low[1], high[1], low[2], high[2])


def block_world(seed: int, *, extent_m: float = 40.0, size_m: float = 4.0, blocks: int = 40) -> RayScene:
    """Boxes at random places on level ground, none at the origin; simulated."""
    rng = np.random.default_rng(seed)
    parts = [box((0.0, 0.0, -0.5), (4 * extent_m, 4 * extent_m, 1.0))]
    while len(parts) <= blocks:
        x, y = rng.uniform(-extent_m, extent_m, 2)
        if math.hypot(x, y) > 2 * size_m:
            sizes = rng.uniform(0.3, 1.0, 3) * size_m
            parts.append(box((x, y, sizes[2] / 2), tuple(sizes)))
    return RayScene(merge(parts))


def pose_at(projection: Projection, x: float, y: float, yaw: float, height: float) -> np.ndarray:
    T = np.eye(4)
    c, s = math.cos(yaw), math.sin(yaw)
    T[:3, :3] = np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)]) @ projection.R_flu_sensor
    T[:3, 3] = x, y, height
    return T


def seen(scene: RayScene, projection: Projection, T: np.ndarray, height: float | None, noise_m: float = 0.01):
    ranges = scene.cast(projection, T)
    ranges = ranges + noise_m * np.random.default_rng(5).standard_normal(ranges.shape).astype(np.float32)
    return make_depth_view(RangeImage(ranges, projection, sensor_height_m=height))


def pose_error(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    off = np.linalg.inv(true) @ found
    turn = math.degrees(math.acos(min(1.0, max(-1.0, (np.trace(off[:3, :3]) - 1) / 2))))
    return float(np.linalg.norm(off[:3, 3])), turn


@pytest.mark.parametrize("sensor", SENSORS)
def test_pose_of_a_return_is_recovered(sensor):
    projection, height = SENSORS[sensor]
    scene = block_world(3)
    first = pose_at(projection, 0.0, 0.0, 0.3, height)
    later = pose_at(projection, 1.3, 0.6, 0.42, height)
    match, query = (seen(scene, projection, T, height) for T in (first, later))
    found = GeometricVerifier().verify(query, match)
    assert found.accepted, found.reason
    metres, degrees = pose_error(found.T_match_query, np.linalg.inv(first) @ later)
    assert metres < 0.15
    assert degrees < 0.6
    assert found.inliers > 50
    assert 0.5 < found.overlap <= 1.0
    assert 0.5 < found.agreement <= 1.0
    assert found.rmse_m < 1.0
    assert found.offset_m == pytest.approx(math.hypot(1.3, 0.6), abs=0.15)
    assert not found.T_match_query.flags.writeable


@pytest.mark.parametrize("sensor", SENSORS)
def test_another_place_is_refused_with_a_reason(sensor):
    projection, height = SENSORS[sensor]
    here = pose_at(projection, 0.0, 0.0, 0.0, height)
    verifier = GeometricVerifier()
    for seed in range(4):
        match, query = (seen(block_world(s), projection, here, height) for s in (seed, seed + 10))
        found = verifier.verify(query, match)
        assert not found.accepted
        assert found.reason


def test_hand_held_view_is_recovered_in_six_degrees_of_freedom():
    scene = block_world(1, extent_m=4.0, size_m=1.2, blocks=120)
    first = pose_at(HAND_HELD, 0.0, 0.0, 0.0, 1.2)
    tilt = np.eye(4)
    a = 0.04
    tilt[:3, :3] = [(1, 0, 0), (0, math.cos(a), -math.sin(a)), (0, math.sin(a), math.cos(a))]
    later = pose_at(HAND_HELD, 0.04, 0.05, 0.05, 1.23) @ tilt
    match, query = (seen(scene, HAND_HELD, T, None, 0.003) for T in (first, later))
    found = GeometricVerifier().verify(query, match)
    assert found.accepted, found.reason
    metres, degrees = pose_error(found.T_match_query, np.linalg.inv(first) @ later)
    assert metres < 0.04
    assert degrees < 0.8


@pytest.mark.parametrize("turn", [2.6, math.pi, -1.2])
def test_reversed_return_of_a_spinning_sensor_is_found_without_knowing_the_turn(turn):
    scene = block_world(5)
    first, later = (pose_at(SPINNING, *at, 1.6) for at in ((0, 0, 0.2), (0.8, -0.5, 0.2 + turn)))
    match, query = (seen(scene, SPINNING, T, 1.6) for T in (first, later))
    found = GeometricVerifier().verify(query, match, yaw_rad=None)
    assert found.accepted, found.reason
    metres, degrees = pose_error(found.T_match_query, np.linalg.inv(first) @ later)
    assert metres < 0.15
    assert degrees < 0.6
    assert not GeometricVerifier().verify(query, match, yaw_rad=0.0).accepted


def test_swapping_the_views_inverts_the_pose():
    scene = block_world(3)
    views = [seen(scene, STEREO, pose_at(STEREO, x, 0.0, 0.3, 1.6), 1.6) for x in (0.0, 0.9)]
    verifier = GeometricVerifier()
    forth, back = verifier.verify(views[1], views[0]), verifier.verify(views[0], views[1])
    metres, degrees = pose_error(forth.T_match_query @ back.T_match_query, np.eye(4))
    assert metres < 0.1
    assert degrees < 0.5


def test_new_obstacle_in_seen_free_space_counts_as_violation():
    wall = box((12.0, 0.0, 3.0), (1.0, 60.0, 6.0))
    truck = box((6.0, 0.0, 1.5), (2.0, 4.0, 3.0))
    here = pose_at(STEREO, 0.0, 0.0, 0.0, 1.6)
    empty, blocked = (
        seen(RayScene(merge(parts)), STEREO, here, 1.6, 0.0) for parts in ([wall], [wall, truck])
    )
    there = view_agreement(blocked.counted, empty, np.eye(4))
    back = view_agreement(empty.counted, blocked, np.eye(4))
    assert there.free > 0.2 * len(blocked.counted)
    assert there.hidden == 0
    assert back.free == 0
    assert back.hidden > 0.1 * len(empty.counted)
    same = view_agreement(empty.counted, empty, np.eye(4))
    assert (same.confirmed, same.overlap, same.free_space_share) == (len(empty.counted), 1.0, 0.0)


def slow_agreement(points, view, pose):
    """The rule of count_agreement, point by point in Python: the counts, and the likeness."""
    height, width = view.ranges_m.shape
    counts = [0, 0, 0, 0]
    likeness = 0.0
    t, n = view.settings.tolerance, view.settings.noise or view.settings.tolerance
    weights = np.linalg.norm(points.astype(np.float64), axis=1)
    moved = points.astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]
    u, v, r = view.projection.project(moved)
    wraps = isinstance(view.projection, Spherical) and view.projection.wraps
    for i in range(len(points)):
        if not (math.isfinite(u[i]) and r[i] > 1e-6):
            counts[3] += 1
            continue
        column = math.floor(u[i] + 0.5) % width if wraps else math.floor(u[i] + 0.5)
        row = 0 if isinstance(view.projection, LaserRow) else math.floor(v[i] + 0.5)
        if not (0 <= column < width and 0 <= row < height):
            counts[3] += 1
            continue
        near = []
        for b in range(max(0, row - 1), min(height, row + 2)):
            for a in range(column - 1, column + 2):
                a = a % width if wraps else a
                if 0 <= a < width and view.ranges_m[b, a] > 0:
                    near.append(float(view.ranges_m[b, a]))
        allowed = t[0] + t[1] * r[i] + t[2] * r[i] ** 2
        if near:
            e = min((x - r[i] for x in near), key=abs) / (n[0] + n[1] * r[i] + n[2] * r[i] ** 2)
            likeness += weights[i] * (1 - e * e / 4 if abs(e) < 2 else -1 if e > 3 else 0)
        if not near:
            counts[3] += 1
        elif any(abs(x - r[i]) <= allowed for x in near):
            counts[0] += 1
        else:
            counts[1 if min(near) < r[i] else 2] += 1
    return counts, likeness / weights.sum()


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000), kind=st.sampled_from(["street", "lidar", "laser"]))
def test_agreement_equals_the_slow_reference(seed, kind):
    rng = np.random.default_rng(seed)
    projection, height = {
        "street": (Pinhole(20.0, 22.0, 15.0, 9.0, 31, 19), 1.0),
        "lidar": (Spherical(36, 9), 1.0),
        "laser": (LaserRow(40, -1.5, 0.07), 1.0),
    }[kind]
    ranges = rng.uniform(1, 12, projection.directions().shape[:2]).astype(np.float32)
    ranges[rng.random(ranges.shape) < 0.2] = np.nan
    view = make_depth_view(RangeImage(ranges, projection, sensor_height_m=height))
    points = rng.uniform(-12, 12, (60, 3)).astype(np.float32)
    if kind == "laser":
        points[:, 2] = 0
    pose = pose_at(projection, *rng.uniform(-1, 1, 3), 0.0)
    pose[:3, :3] = pose[:3, :3] @ projection.R_flu_sensor.T
    counted = view_agreement(points, view, pose, np.linalg.norm(points, axis=1))
    counts, likeness = slow_agreement(points, view, pose)
    assert [counted.confirmed, counted.hidden, counted.free, counted.unseen] == counts
    assert counted.likeness == pytest.approx(likeness, abs=1e-6)


def test_scan_alignment_survives_a_corridor():
    ranges = np.full((1, 360), np.nan, dtype=np.float32)
    angles = -math.pi / 2 + np.arange(360) * math.pi / 360
    with np.errstate(divide="ignore"):
        ranges[0] = np.minimum(1.2 / np.abs(np.sin(angles)), 40.0)
    view = make_depth_view(RangeImage(ranges, ROW, sensor_height_m=0.5))
    found = GeometricVerifier().verify(view, view)
    assert np.isfinite(found.T_match_query).all()
    assert found.overlap > 0.9


def test_given_pose_is_refined_where_the_search_would_not_reach():
    scene = block_world(5)
    first, later = (pose_at(SPINNING, *at, 1.6) for at in ((0, 0, 0.0), (0.5, 0.5, 2.0)))
    match, query = (seen(scene, SPINNING, T, 1.6) for T in (first, later))
    near = np.linalg.inv(first) @ pose_at(SPINNING, 0.2, 0.3, 1.97, 1.6)
    found = GeometricVerifier().verify(query, match, starts=(near,))
    assert found.accepted
    assert found.start == "given pose"


def test_seconded_match_needs_less_overlap():
    scene = block_world(3)
    match, query = (
        seen(scene, STEREO, pose_at(STEREO, *at, 1.6), 1.6) for at in ((0, 0, 0.3), (0.5, 0.0, 0.3))
    )
    overlap = GeometricVerifier().verify(query, match).overlap
    strict = VerificationSettings(
        min_overlap=min(1.0, overlap + 0.02), min_overlap_seconded=overlap - 0.1, max_free_space_share=1.0
    )
    match, query = (
        make_depth_view(RangeImage(v.ranges_m, v.projection, sensor_height_m=1.6), strict)
        for v in (match, query)
    )
    verifier = GeometricVerifier()
    assert not verifier.verify(query, match).accepted
    assert verifier.verify(query, match, seconded=True).accepted


def test_far_points_and_close_agreement_make_likeness():
    wall = box((12.0, 0.0, 3.0), (1.0, 60.0, 6.0))
    here = pose_at(STEREO, 0.0, 0.0, 0.0, 1.6)
    view = seen(RayScene(merge([wall])), STEREO, here, 1.6, 0.0)
    assert view_agreement(view.counted, view, np.eye(4)).likeness == pytest.approx(1.0)
    beside = np.eye(4)
    likeness = []
    for offset in (0.2, 0.4):
        beside[2, 3] = offset
        shifted = view_agreement(view.counted, view, beside)
        assert shifted.overlap > 0.9
        likeness.append(shifted.likeness)
    assert 1.0 > likeness[0] > likeness[1] > 0.0
    beside[2, 3] = -4.0
    assert view_agreement(view.counted, view, beside).likeness < -0.4


def test_street_view_that_agrees_too_little_within_noise_is_refused_unless_seconded():
    scene = block_world(3)
    match, query = (
        seen(scene, STEREO, pose_at(STEREO, *at, 1.6), 1.6) for at in ((0, 0, 0.3), (0.5, 0.0, 0.3))
    )
    found = GeometricVerifier().verify(query, match)
    assert found.accepted
    strict = replace(
        match.settings, min_agreement=min(1.0, found.agreement + 0.05), min_agreement_seconded=0.1
    )
    lone = judged(found, strict, seconded=False)
    assert not lone.accepted
    assert "within their noise" in lone.reason
    seconded = judged(lone, strict, seconded=True)
    assert seconded.accepted
    np.testing.assert_array_equal(seconded.T_match_query, found.T_match_query)


def test_refining_a_given_pose_searches_no_other():
    scene = block_world(3)
    first, later = (pose_at(STEREO, *at, 1.6) for at in ((0, 0, 0.3), (1.0, 0.3, 0.35)))
    match, query = (seen(scene, STEREO, T, 1.6) for T in (first, later))
    near = GeometricVerifier().refine(query, match, np.linalg.inv(first) @ later)
    assert near.accepted
    assert near.start == "given pose"
    assert not GeometricVerifier().refine(query, match, pose_at(STEREO, 30.0, 0.0, 1.5, 0.0)).accepted


def test_missing_small_gicp_names_the_pip_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    scene = block_world(1, extent_m=4.0, size_m=1.2, blocks=120)
    view = seen(scene, HAND_HELD, pose_at(HAND_HELD, 0, 0, 0.3, 1.2), None)
    with pytest.raises(MissingExtraError, match=r"pip install 'depthprint\[slam\]'"):
        GeometricVerifier().verify(view, view)
    for projection, height in SENSORS.values():
        view = seen(block_world(3), projection, pose_at(projection, 0, 0, 0.3, height), height)
        assert GeometricVerifier().verify(view, view).accepted


def test_absent_kiss_matcher_is_said(monkeypatch):
    monkeypatch.setattr("depthprint.verification.verifier.kiss_matcher_installed", lambda: False)
    assert "kiss-matcher is not installed" in GeometricVerifier(kiss_matcher="fallback").starts_from
    assert "kiss" not in GeometricVerifier().starts_from


def test_kiss_matcher_finds_a_turn_that_the_search_does_not():
    pytest.importorskip("kiss_matcher")
    scene = block_world(5)
    first, later = (pose_at(SPINNING, *at, 1.6) for at in ((0, 0, 0.0), (0.5, 0.5, 0.7)))
    match, query = (seen(scene, SPINNING, T, 1.6) for T in (first, later))
    low = VerificationSettings(columns=360, voxel_m=0.5, coarse_overlap=0.0, tolerance=(0.3, 0.01, 0.0))
    match, query = (
        make_depth_view(RangeImage(v.ranges_m, v.projection, sensor_height_m=1.6), low)
        for v in (match, query)
    )
    assert not GeometricVerifier().verify(query, match).accepted
    found = GeometricVerifier(kiss_matcher="fallback").verify(query, match)
    assert found.accepted
    assert found.start == "kiss-matcher"


def test_views_of_different_kinds_are_refused():
    row = seen(block_world(3), ROW, pose_at(ROW, 0, 0, 0, 0.5), 0.5)
    camera = seen(block_world(3), STEREO, pose_at(STEREO, 0, 0, 0, 1.6), 1.6)
    with pytest.raises(DataError, match="one kind of sensor, got Pinhole and LaserRow"):
        GeometricVerifier().verify(camera, row)


def test_view_is_thinned_and_keeps_its_geometry():
    big = Pinhole(fx=585.0, fy=585.0, cx=320.0, cy=240.0, width=640, height=480)
    view = make_depth_view(RangeImage(np.full((480, 640), 2.0, dtype=np.float32), big))
    assert view.ranges_m.shape == (120, 160)
    assert not view.ranges_m.flags.writeable
    np.testing.assert_allclose(view.points[:, 2], 2.0)
    assert view.points[:, 0].max() == pytest.approx(2.0 * 319 / 585, abs=0.02)
    assert len(view.counted) == 1200
    far = make_depth_view(RangeImage(np.full((480, 640), 9.0, dtype=np.float32), big))
    assert len(far.points) == 0


@pytest.mark.parametrize("mirrored", [False, True])
def test_empty_and_out_of_reach_views_are_never_accepted(mirrored):
    nothing = make_depth_view(RangeImage(np.full((120, 160), 30.0, dtype=np.float32), HAND_HELD))
    something = seen(
        block_world(1, extent_m=4.0, size_m=1.2), HAND_HELD, pose_at(HAND_HELD, 0, 0, 0, 1), None
    )
    pair = (something, nothing) if mirrored else (nothing, something)
    assert not GeometricVerifier().verify(*pair).accepted
    with pytest.raises(DataError, match="at least one return"):
        make_depth_view(RangeImage(np.full((120, 160), np.nan, dtype=np.float32), HAND_HELD))


def test_settings_follow_the_sensor():
    row, spin = (RangeImage(np.ones(p.directions().shape[:2], dtype=np.float32), p) for p in (ROW, SPINNING))
    camera = RangeImage(np.ones((94, 155), dtype=np.float32), STEREO)
    on_a_car = camera.replace(sensor_height_m=1.6)
    kinds = [settings_for(image) for image in (row, spin, camera, on_a_car)]
    assert len(set(kinds)) == 4
    assert settings_for(camera).reach_m < settings_for(on_a_car).reach_m


@pytest.mark.parametrize(
    "bad",
    [
        {"voxel_m": 0.0},
        {"min_overlap": 1.5},
        {"columns": 0},
        {"yaw_rad": ()},
        {"max_offset_m": -1.0},
        {"max_free_space_share": -0.1},
        {"min_agreement": 1.1},
        {"reached_elsewhere": 1.0},
        {"witness_m": 0.0},
        {"agreeing_rad": 0.0},
    ],
)
def test_settings_out_of_range_raise(bad):
    with pytest.raises(SettingsError, match=next(iter(bad))):
        VerificationSettings(**bad)
    with pytest.raises(SettingsError, match="fallback"):
        GeometricVerifier(kiss_matcher="always")


def test_malformed_poses_and_points_raise():
    view = seen(block_world(3), STEREO, pose_at(STEREO, 0, 0, 0.3, 1.6), 1.6)
    with pytest.raises(DataError, match="pose"):
        view_agreement(view.counted, view, np.eye(3))
    with pytest.raises(DataError, match="points"):
        view_agreement(view.counted[:, :2], view, np.eye(4))
