"""Scan Context, M2DP and SeqSLAM against their papers' definitions, written out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from depthprint.baselines.m2dp import M2dpRecognizer, m2dp_descriptors
from depthprint.baselines.scan_context import ScanContextRecognizer
from depthprint.baselines.seqslam import SeqSlamRecognizer, enhanced_contrast
from depthprint.errors import DataError, SettingsError
from depthprint.projection import Spherical
from depthprint.range_image import RangeImage
from synthetic import CAMERA, boxes, scan

RING = Spherical(360, 16, elevation_min_rad=-0.3, elevation_max_rad=0.3)


def around(seed: int, turn: int = 0) -> RangeImage:
    """A scene all around the sensor, turned by so many of 360 columns."""
    image = boxes(seed, RING)
    return image.replace(ranges_m=np.roll(image.ranges_m, turn, axis=1))


def slow_scan_context(image, sectors, rings, reach_m):
    """Highest point of each cell, point by point; sector 0 begins straight behind, on the left."""
    grid = np.zeros((rings, sectors))
    for x, y, z in image.points_flu().reshape(-1, 3).astype(float):
        distance, height = math.hypot(x, y), z + image.sensor_height_m
        if not math.isfinite(x) or distance >= reach_m or height <= 0:
            continue
        sector = math.floor((math.pi - math.atan2(y, x)) / (2 * math.pi) * sectors) % sectors
        ring = math.floor(distance / reach_m * rings)
        grid[ring, sector] = max(grid[ring, sector], height)
    return grid


def slow_distance(a, b):
    """Least over all turns of one minus the mean cosine of the columns that hold something in both."""
    least = np.inf
    for turn in range(a.shape[1]):
        moved, cosines = np.roll(a, turn, axis=1), []
        for q, c in zip(moved.T, b.T, strict=True):
            if q.any() and c.any():
                cosines.append(q @ c / np.linalg.norm(q) / np.linalg.norm(c))
        least = min(least, 1 - np.mean(cosines))
    return least


def test_scan_context_and_its_distance_follow_the_paper():
    recognizer = ScanContextRecognizer(sectors=24, rings=8, reach_m=16.0)
    images = [around(seed) for seed in range(3)]
    grids = [slow_scan_context(image, 24, 8, 16.0) for image in images]
    described = [recognizer.describe(image) for image in images]
    for grid, context in zip(grids, described, strict=True):
        assert np.allclose(context.ring_key, (grid > 0).mean(axis=1), atol=1e-6)
        norms = np.linalg.norm(grid, axis=0)
        assert np.allclose(context.columns.T * norms, grid, atol=1e-4)
    assert recognizer.distance(described[0], described[1]) == pytest.approx(
        slow_distance(grids[0], grids[1]), abs=1e-5
    )


def test_a_turned_scan_is_found_with_its_turn():
    recognizer = ScanContextRecognizer(sectors=60, reach_m=16.0)
    for seed in range(5):
        recognizer.add(recognizer.describe(around(seed)))
    best = recognizer.query(recognizer.describe(around(3, turn=6 * 17)))[0]
    assert best.place == 3
    assert best.shift == 60 - 17
    assert best.distance == pytest.approx(0, abs=1e-5)


def test_ring_keys_choose_which_places_are_compared():
    few = ScanContextRecognizer(sectors=24, reach_m=16.0, candidates=4)
    every = ScanContextRecognizer(sectors=24, reach_m=16.0, candidates=None)
    described = [every.describe(around(seed)) for seed in range(20)]
    for d in described:
        few.add(d)
        every.add(d)
    query = every.describe(around(30))
    keys = np.array([d.ring_key for d in described])
    nearest = set(np.argsort(np.linalg.norm(keys - query.ring_key, axis=1))[:4].tolist())
    assert {m.place for m in few.query(query, k=4)} == nearest
    assert len(few.query(query, k=9)) == 9
    assert every.query(query)[0].distance <= few.query(query)[0].distance


def test_scan_context_of_a_camera_shifts_a_little_and_no_more():
    fan = Spherical(240, 16, -0.6, 0.6, -0.3, 0.3)
    recognizer = ScanContextRecognizer(sectors=24, reach_m=16.0, full_circle=False, max_shift=2)
    for seed in range(4):
        recognizer.add(recognizer.describe(boxes(seed, fan)))
    turned = boxes(2, fan).replace(ranges_m=np.roll(boxes(2, fan).ranges_m, 20, axis=1))
    best = recognizer.query(recognizer.describe(turned))[0]
    assert (best.place, best.shift) == (2, -2)


def slow_m2dp(points, p, q, circles, sectors):
    """First reading of the paper's signature: planes, rings and sectors one at a time."""
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov(centred.T))
    x_axis, y_axis = axes[:, 2], axes[:, 1]
    cloud = centred @ np.stack([x_axis, y_axis, np.cross(x_axis, y_axis)], axis=1)
    reach = np.linalg.norm(cloud, axis=1).max()
    radii = [reach * (i / circles) ** 2 for i in range(1, circles + 1)]
    rows = []
    for i in range(p):
        for j in range(q):
            theta, phi = i * math.pi / p, j * math.pi / (2 * q)
            normal = np.array(
                [math.cos(phi) * math.cos(theta), math.cos(phi) * math.sin(theta), math.sin(phi)]
            )
            x_on_plane = np.array([1.0, 0, 0]) - normal[0] * normal
            length = np.linalg.norm(x_on_plane)
            x_on_plane = x_on_plane / length if length > 1e-9 else np.array([0.0, 0, 1])
            y_on_plane = np.cross(normal, x_on_plane)
            row = np.zeros((circles, sectors))
            for point in cloud:
                u, v = point @ x_on_plane, point @ y_on_plane
                ring = next((k for k, r in enumerate(radii) if math.hypot(u, v) < r), circles - 1)
                row[ring, int((math.atan2(v, u) % (2 * math.pi)) / (2 * math.pi) * sectors) % sectors] += 1
            rows.append(row.ravel() / len(points))
    left, _, right = np.linalg.svd(np.array(rows))
    return np.concatenate([np.abs(left[:, 0]), np.abs(right[0])])


def cloud(seed, n=300):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 3)) * [8.0, 3.0, 1.0] + rng.uniform(-1, 1, 3) + rng.exponential(2.0, (n, 3))


def test_m2dp_follows_the_paper():
    points = cloud(0)
    found = m2dp_descriptors(points, azimuths=3, elevations=4, circles=4, sectors=8)
    assert found.shape == (4, 3 * 4 + 4 * 8)
    slow = slow_m2dp(points, 3, 4, 4, 8)
    assert np.abs(found - slow).max(axis=1).min() < 0.02


def test_m2dp_is_the_same_wherever_the_cloud_lies_and_however_it_is_turned():
    points, other = cloud(1), cloud(2)
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    moved = m2dp_descriptors(points @ turn.T + [5.0, -3.0, 1.0])

    def apart(a, b):
        return np.linalg.norm(a - b[0], axis=1).min()

    still = m2dp_descriptors(points)
    assert apart(moved, still) < 0.02
    assert apart(moved, still) < apart(m2dp_descriptors(other), still) / 5


def test_m2dp_refuses_too_few_points_naming_the_frame():
    with pytest.raises(DataError, match=r"three or more finite points"):
        m2dp_descriptors(np.zeros((2, 3)))
    ranges = np.full((96, 128), np.nan, dtype=np.float32)
    ranges[4, 7] = 3.0
    with pytest.raises(DataError, match=r"lonely: m2dp"):
        M2dpRecognizer().describe(RangeImage(ranges, CAMERA, source="lonely"))
    with pytest.raises(SettingsError, match="every number >= 1"):
        M2dpRecognizer(circles=0)


def test_enhanced_contrast_is_the_deviation_from_the_neighbourhood():
    values = np.random.default_rng(4).random(30)
    fast = enhanced_contrast(values, 6)
    for i in range(30):
        low = max(0, i - 3)
        high = min(30, low + 6)
        around_i = values[max(0, high - 6) : high]
        assert fast[i] == pytest.approx((values[i] - around_i.mean()) / around_i.std(), abs=1e-6)
    assert np.array_equal(enhanced_contrast(np.full(9, 3.3), 4), np.zeros(9))
    assert enhanced_contrast([], 4).shape == (0,)
    with pytest.raises(SettingsError, match="window"):
        enhanced_contrast([1.0], 1)


def test_seqslam_follows_straight_lines_through_the_difference_matrix():
    frames, window, speeds = 4, 6, (1.0, 2.0)
    recognizer = SeqSlamRecognizer(frames=frames, window=window, speeds=speeds, size=8)
    described = [recognizer.describe(boxes(seed)) for seed in range(16)]
    limit = 9
    for d in described[:-1]:
        recognizer.add(d)
    found = {m.place: m.distance for m in recognizer.query(described[-1], k=20, limit=limit)}
    assert sorted(found) == list(range(limit))
    latest = [described[-1], *reversed(described[-frames:-1])]
    rows = [
        enhanced_contrast([recognizer.distance(d, described[j]) for j in range(limit)], window)
        for d in latest
    ]
    for place, distance in found.items():
        sums = []
        for speed in speeds:
            steps = [place - round(back * speed) for back in range(frames)]
            sums.append(sum(row[j] for row, j in zip(rows, steps, strict=True) if j >= 0))
        assert distance == pytest.approx(min(sums) / frames, abs=1e-3)


def test_seqslam_finds_a_route_where_single_frames_are_too_alike():
    """The second lap shows the first under noise that hides a single frame among its likes."""
    rng = np.random.default_rng(5)
    base = np.asarray(boxes(0).ranges_m)
    lap = [
        np.nan_to_num(base, nan=9.0) + 0.1 * rng.normal(size=(12, 16)).repeat(8, 0).repeat(8, 1)
        for _ in range(30)
    ]
    recognizer = SeqSlamRecognizer(frames=8, speeds=(1.0,))
    alone = SeqSlamRecognizer(frames=1, speeds=(1.0,))
    right = {id(recognizer): 0, id(alone): 0}
    for number in range(60):
        noise = 0.25 * rng.normal(size=(12, 16)).repeat(8, 0).repeat(8, 1)
        image = RangeImage((lap[number % 30] + noise).astype(np.float32), CAMERA)
        for method in (recognizer, alone):
            described = method.describe(image)
            if number >= 38:
                right[id(method)] += method.query(described, limit=30)[0].place == number - 30
            method.add(described)
    assert right[id(recognizer)] == 22
    assert right[id(alone)] < 22


def test_rows_of_a_planar_scanner_are_taken_by_all_three():
    for recognizer in (
        ScanContextRecognizer(value="count", full_circle=False),
        M2dpRecognizer(),
        SeqSlamRecognizer(),
    ):
        for seed in range(4):
            recognizer.add(recognizer.describe(scan(seed)))
        assert recognizer.query(recognizer.describe(scan(2)))[0].place in range(4)


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(SettingsError, match="reach_m > 0"):
        ScanContextRecognizer(reach_m=0.0)
    with pytest.raises(SettingsError, match="frames >= 1"):
        SeqSlamRecognizer(frames=0)
