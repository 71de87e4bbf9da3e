"""Aligning the points of two frames: known motions come back, strangers do not overlap."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from depthprint.errors import DataError, MissingExtraError, SettingsError
from depthprint.frame_alignment import align_frames, align_points
from depthprint.place_methods import load_shipped_encoder
from depthprint.pose_graph import inverse_pose
from depthprint.projection import Spherical
from depthprint.range_image import RangeImage
from synthetic import boxes


def room(seed: int, n: int = 4000) -> np.ndarray:
    """Points on the walls, the floor and the boxes of a room, metres."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((-5, -4, 0), (5, 4, 2.5), (n, 3))
    side = rng.integers(0, 5, n)
    points[side == 0, 0] = -5
    points[side == 1, 0] = 5
    points[side == 2, 1] = -4
    points[side == 3, 1] = 4
    points[side == 4, 2] = 0
    boxes = [
        rng.uniform((-4, -3, 0), (4, 3, 1.5), 3) + rng.uniform(0, (1, 1, 0.05), (300, 3)) for _ in range(6)
    ]
    return np.concatenate([points, *boxes])


def motion(x_m: float, y_m: float, turn_deg: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("z", turn_deg, degrees=True).as_matrix()
    T[:3, 3] = x_m, y_m, 0.02
    return T


def seen_from(points: np.ndarray, T_world_sensor: np.ndarray, seed: int) -> np.ndarray:
    T = inverse_pose(T_world_sensor)
    return points @ T[:3, :3].T + T[:3, 3] + np.random.default_rng(seed).normal(0, 0.01, points.shape)


@pytest.mark.parametrize(("x_m", "y_m", "turn_deg"), [(0.0, 0.0, 0.0), (0.4, -0.3, 8.0), (-0.5, 0.2, -12.0)])
def test_a_known_motion_comes_back(x_m, y_m, turn_deg):
    pytest.importorskip("small_gicp")
    points, T_match_query = room(1), motion(x_m, y_m, turn_deg)
    match = seen_from(points[::2], np.eye(4), 1)
    query = seen_from(points[1::2], T_match_query, 2)
    found = align_points(query, match, voxel_m=0.15, reach_m=1.0)
    error = inverse_pose(T_match_query) @ found.T_match_query
    assert np.linalg.norm(error[:3, 3]) < 0.02
    assert np.degrees(Rotation.from_matrix(error[:3, :3]).magnitude()) < 0.3
    assert found.overlap > 0.8
    assert found.inliers > 500
    assert not found.T_match_query.flags.writeable


def test_of_several_starts_the_one_of_most_overlap_counts():
    pytest.importorskip("small_gicp")
    points, T_match_query = room(2), motion(0.3, 0.1, 170.0)
    match, query = seen_from(points[::2], np.eye(4), 1), seen_from(points[1::2], T_match_query, 2)
    starts = [np.eye(4), motion(0, 0, 90.0), motion(0, 0, 180.0)]
    alone = align_points(query, match, starts[:1], voxel_m=0.15)
    found = align_points(query, match, starts, voxel_m=0.15)
    assert found.overlap > alone.overlap
    np.testing.assert_allclose(found.T_match_query, T_match_query, atol=0.02)


def test_another_room_overlaps_less():
    pytest.importorskip("small_gicp")
    stranger = room(4) * (1.6, 0.7, 1.2)
    same = align_points(room(3)[1::2], room(3)[::2], voxel_m=0.15)
    other = align_points(stranger, room(3), voxel_m=0.15)
    assert other.overlap < 0.6 < same.overlap


def test_what_cannot_be_aligned_is_refused_or_none():
    pytest.importorskip("small_gicp")
    points = room(1)
    assert align_points(points[:5], points) is None
    assert align_points(np.empty((0, 3)), points) is None
    with pytest.raises(DataError, match=r"points \(n, 3\) of the match, got shape \(4, 2\)"):
        align_points(points, np.ones((4, 2)))
    with pytest.raises(DataError, match="of the query"):
        align_points(np.full((9, 3), np.nan), points)
    with pytest.raises(DataError, match="starts, pose 0"):
        align_points(points, points, [np.zeros((4, 4))])
    for lengths in ({"voxel_m": 0.0}, {"reach_m": -1.0}, {"reach_m": np.inf}):
        with pytest.raises(SettingsError, match="lengths > 0"):
            align_points(points, points, **lengths)


def test_without_small_gicp_the_pip_line_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'depthprint\[slam\]'"):
        align_points(room(1), room(1))


def lidar(seed: int, turn_deg: float) -> RangeImage:
    """What a spinning sensor in the middle of a room sees, turned to the left."""
    spinning = Spherical(width=360, height=24, elevation_min_rad=-0.4, elevation_max_rad=0.3)
    points = seen_from(4 * room(seed, 60000) - (0, 0, 2.0), motion(0, 0, turn_deg), seed)
    return RangeImage.from_points(points, spinning, sensor_height_m=2.0)


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, -120.0])
def test_the_shift_of_a_full_circle_says_how_far_the_sensor_has_turned(turn_deg):
    encoder = load_shipped_encoder("lidar")
    index = encoder.make_index()
    index.add(encoder.describe(lidar(5, 0.0)).signatures)
    (match,) = index.query(encoder.describe(lidar(5, turn_deg)).signatures)
    yaw_deg = np.degrees(encoder.yaw_of_shift(encoder.shift_sectors()[match.shift_index]))
    assert (yaw_deg - turn_deg + 180) % 360 - 180 == pytest.approx(0, abs=15)
    assert encoder.yaw_of_shift(None) == 0
    assert load_shipped_encoder("street").yaw_of_shift(3.0) == 0


def test_frames_are_aligned_from_the_turn_that_was_seen():
    pytest.importorskip("small_gicp")
    query, match = lidar(5, 120.0), lidar(5, 0.0)
    found = align_frames(query, match, np.radians(110.0))
    np.testing.assert_allclose(found.T_match_query[:3, :3], motion(0, 0, 120.0)[:3, :3], atol=0.01)
    assert align_frames(query, match, np.radians(110.0), least_overlap=1.0) is None
    near = align_frames(boxes(1, shift=1), boxes(1))
    assert near.overlap > 0.5
    assert np.linalg.norm(near.T_match_query[:3, 3]) < 0.5
    with pytest.raises(SettingsError, match="yaw_rad"):
        align_frames(query, match, np.nan)
    with pytest.raises(SettingsError, match="least_overlap"):
        align_frames(query, match, least_overlap=2.0)
    with pytest.raises(DataError, match="at least one return"):
        align_frames(query.replace(ranges_m=np.full(query.shape, np.nan, dtype=np.float32)), match)
