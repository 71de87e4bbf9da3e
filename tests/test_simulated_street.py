"""The simulated street as a data set."""

import math

import numpy as np
import pytest

from depthprint.datasets.simulated_street import simulated_street
from depthprint.errors import DataError, SettingsError
from depthprint.projection import LaserRow, Pinhole, Spherical


def street(**options):
    return simulated_street(length_m=options.pop("length_m", 300.0), **options)


@pytest.fixture(scope="module")
def stereo():
    return street(seed=5)


def same(first, second) -> bool:
    return np.array_equal(first.ranges_m, second.ranges_m, equal_nan=True)


def test_the_same_seed_gives_the_same_frames_in_any_order(stereo):
    again = street(seed=5)
    frames = [0, 60, 61, 250]
    forward = [stereo[f] for f in frames]
    backward = [again[f] for f in reversed(frames)][::-1]
    assert all(same(a, b) for a, b in zip(forward, backward, strict=True))
    assert np.array_equal(stereo.poses, again.poses)


def test_another_seed_is_another_town(stereo):
    other = street(seed=6)
    assert not np.allclose(stereo.poses[10], other.poses[10])
    assert not same(stereo[10], other[10])


def test_it_says_that_it_is_simulated_and_how(stereo):
    assert stereo.simulated
    assert "simulated" in stereo.name
    assert "seed 5" in stereo.name
    assert "20%" in stereo.name
    assert "frame 7" in stereo[7].source


def test_its_frames_look_like_a_street(stereo):
    for frame in (0, 100, 200, 300):
        image = stereo[frame]
        assert image.ranges_m.dtype == np.float32
        assert 0.4 < np.isfinite(image.ranges_m).mean() < 1.0
        assert 2.0 <= np.nanmin(image.ranges_m) < 10.0
        assert np.nanmax(image.ranges_m) <= 80.0


def test_every_takes_each_kth_frame_and_scales_the_gap(stereo):
    sparse = street(seed=5, every=4)
    assert len(sparse) == math.ceil(len(stereo) / 4)
    assert np.array_equal(sparse.poses, stereo.poses[::4])
    assert same(sparse[20], stereo[80])
    assert (stereo.truth.gap, sparse.truth.gap) == (100, 25)
    assert street(seed=5, every=1000).truth.gap == 1
    with pytest.raises(IndexError):
        sparse[len(sparse)]


@pytest.mark.parametrize(
    ("sensor", "projection", "preset", "heading_deg", "height_m"),
    [
        ("stereo", Pinhole, "street", 45.0, 1.65),
        ("kinect", Pinhole, "street", 45.0, 1.2),
        ("lidar", Spherical, "lidar", None, 1.73),
        ("laser", LaserRow, "laser", 45.0, 0.5),
    ],
)
def test_each_sensor_has_its_projection_preset_and_truth(sensor, projection, preset, heading_deg, height_m):
    sequence = street(sensor=sensor, seed=1)
    image = sequence[30]
    assert isinstance(image.projection, projection)
    assert image.ranges_m.shape == (image.projection.height, image.projection.width)
    assert np.isfinite(image.ranges_m).any()
    assert sequence.preset == preset
    assert sequence.truth.heading_deg == heading_deg
    assert image.sensor_height_m == height_m
    assert np.allclose(sequence.poses[:, 2, 3], height_m)
    assert sequence.world_up == (0.0, 0.0, 1.0)


def test_consecutive_scans_agree_about_the_world():
    sequence = street(sensor="lidar", seed=2)
    first, second = sequence[100], sequence[101]
    points = first.points_flu().reshape(-1, 3).astype(float)
    points = points[np.isfinite(points[:, 0])]
    T = np.linalg.inv(sequence.poses[101]) @ sequence.poses[100]
    u, v, ranges = second.projection.project(points @ T[:3, :3].T + T[:3, 3])
    columns, rows = np.round(u).astype(int), np.round(v).astype(int)
    inside = (rows >= 0) & (rows < second.projection.height)
    columns = columns[inside] % second.projection.width
    error = np.abs(second.ranges_m[rows[inside], columns] - ranges[inside])
    assert np.nanmedian(error / ranges[inside]) < 0.02


def kitti_file(path, count=60, step_m=1.0):
    rows = [[1, 0, 0, 0.02 * i * i, 0, 1, 0, 0, 0, 0, 1, step_m * i] for i in range(count)]
    np.savetxt(path, rows)
    return path


def test_a_kitti_pose_file_is_driven(tmp_path):
    sequence = simulated_street(poses_file=kitti_file(tmp_path / "42.txt"), every=3, seed=1)
    assert len(sequence) == 20
    assert "42" in sequence.name
    assert np.allclose(sequence.poses[:, 0, 3], 3.0 * np.arange(20))
    assert np.allclose(sequence.poses[:, 1, 3], -0.02 * (3.0 * np.arange(20)) ** 2)
    assert np.isfinite(sequence[5].ranges_m).mean() > 0.3


def test_a_wrong_pose_file_is_an_error_that_names_it(tmp_path):
    with pytest.raises(DataError, match=r"nowhere\.txt"):
        simulated_street(poses_file=tmp_path / "nowhere.txt")
    with pytest.raises(DataError, match=r"one\.txt.*two poses"):
        simulated_street(poses_file=kitti_file(tmp_path / "one.txt", count=1))


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"sensor": "sonar"}, "sensor"),
        ({"every": 0}, "every"),
        ({"every": -3}, "every"),
        ({"every": 1.5}, "every"),
        ({"cars_redrawn": -0.1}, "cars_redrawn"),
        ({"cars_redrawn": 1.1}, "cars_redrawn"),
        ({"cars_redrawn": math.nan}, "cars_redrawn"),
        ({"length_m": 10.0}, "length_m"),
        ({"length_m": math.inf}, "length_m"),
        ({"seed": -1}, "seed"),
        ({"seed": 0.5}, "seed"),
    ],
)
def test_a_wrong_option_is_an_error_that_names_it(options, word):
    with pytest.raises(SettingsError, match=word):
        street(**options)


def test_a_length_and_a_pose_file_exclude_each_other(tmp_path):
    with pytest.raises(SettingsError, match="length_m"):
        simulated_street(poses_file=kitti_file(tmp_path / "42.txt"), length_m=500.0)


def test_progress_is_told_to_its_end():
    calls = []
    street(progress=lambda done, total: calls.append((done, total)))
    assert calls == [(0, 2), (1, 2), (2, 2)]


@pytest.mark.parametrize(
    ("sensor", "rows", "preset", "heading"),
    [("lidar-16", 16, "lidar", None), ("lidar-32", 32, "lidar", None), ("lidar-ahead", 64, "street", 45.0)],
)
def test_other_lidars_have_their_beams_and_preset(sensor, rows, preset, heading):
    sequence = simulated_street(sensor=sensor, seed=3, length_m=300.0, every=40)
    image = sequence[1]
    assert image.shape[0] == rows
    assert image.valid.mean() > 0.2
    assert (sequence.preset, sequence.truth.heading_deg) == (preset, heading)
