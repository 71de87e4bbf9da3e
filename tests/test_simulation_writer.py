"""Sequences written as recordings, read back by the generic loader."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from depthprint.datasets.base import RangeSequence
from depthprint.datasets.generic import generic
from depthprint.errors import DataError
from depthprint.projection import LaserRow, Pinhole, Spherical
from depthprint.range_image import RangeImage
from depthprint.simulation.rooms import simulated_rooms
from depthprint.simulation.writer import write_sequence

CAMERA = Pinhole(fx=20.3, fy=20.1, cx=11.7, cy=7.9, width=24, height=16)
SCANNER = Spherical(32, 8, elevation_min_rad=-0.43, elevation_max_rad=0.034)


def test_pinhole_sequence_reads_back_within_half_a_step(tmp_path):
    written = _sequence(CAMERA, far_m=60.0, sensor_height_m=1.65)
    read = generic(write_sequence(written, tmp_path / "drive"))
    assert _fields(tmp_path / "drive")["depth_scale_m"] == 0.001
    assert (read.preset, read.simulated, len(read)) == ("street", True, 5)
    np.testing.assert_array_equal(read.poses, written.poses)
    for i in range(5):
        assert read[i].projection == written[i].projection
        assert read[i].sensor_height_m == 1.65
        np.testing.assert_array_equal(read[i].valid, written[i].valid)
        np.testing.assert_allclose(read[i].ranges_m, written[i].ranges_m, rtol=0, atol=0.000501 + 4e-6)


@pytest.mark.parametrize(
    ("far_m", "scale_m"), [(65.5, 0.001), (65.6, 0.002), (131.2, 0.005), (327.0, 0.005), (600.0, 0.01)]
)
def test_step_grows_with_the_largest_range_wherever_it_is(tmp_path, far_m, scale_m):
    written = _sequence(CAMERA, far_m=20.0)
    far = np.full((16, 24), far_m, dtype=np.float32)
    spike = replace(written, read=lambda i: _image(far) if i == 3 else written[i])
    read = generic(write_sequence(spike, tmp_path / "drive"))
    assert _fields(tmp_path / "drive")["depth_scale_m"] == scale_m
    for i in range(5):
        np.testing.assert_allclose(read[i].ranges_m, spike[i].ranges_m, rtol=1e-6, atol=scale_m / 2)


def test_spherical_sequence_reads_back_exactly(tmp_path):
    written = _sequence(SCANNER, far_m=100.0, sensor_height_m=1.73)
    read = generic(write_sequence(written, tmp_path / "scans"))
    assert (read.preset, read.simulated) == ("lidar", True)
    np.testing.assert_array_equal(read.poses, written.poses)
    for i in range(5):
        assert read[i].projection == SCANNER
        assert read[i].sensor_height_m == 1.73
        np.testing.assert_array_equal(read[i].ranges_m, written[i].ranges_m)


def test_simulated_rooms_read_back_as_handheld(tmp_path):
    written = simulated_rooms(6, seed=1, n_rooms=1)
    read = generic(write_sequence(written, tmp_path / "rooms"))
    assert (read.preset, read.truth, read.world_up) == ("handheld", written.truth, written.world_up)
    np.testing.assert_array_equal(read.poses, written.poses)
    for i in range(6):
        np.testing.assert_allclose(read[i].ranges_m, written[i].ranges_m, rtol=0, atol=0.000501)


def test_real_sequences_are_not_called_simulated(tmp_path):
    real = replace(_sequence(CAMERA, far_m=5.0), simulated=False, poses=None)
    folder = write_sequence(real, tmp_path / "real")
    assert "simulated" not in _fields(folder)
    read = generic(folder)
    assert not read.simulated
    assert read.poses is None


def test_frame_order_survives_many_frames(tmp_path):
    n = 12
    many = RangeSequence("many", lambda i: _image(np.full((16, 24), 1.0 + i)), n, "handheld")
    read = generic(write_sequence(many, tmp_path / "many"))
    assert [float(read[i].ranges_m[0, 0]) for i in range(n)] == pytest.approx(range(1, n + 1))


def test_progress_reaches_the_last_frame(tmp_path):
    seen = []
    write_sequence(_sequence(CAMERA, far_m=5.0), tmp_path / "f", progress=lambda *call: seen.append(call))
    assert seen == [(i, 5) for i in range(1, 6)]


def test_an_error_midway_leaves_nothing(tmp_path):
    whole = _sequence(CAMERA, far_m=5.0)

    def read(index):
        if index == 3:
            raise DataError("frame 3 is damaged")
        return whole[index]

    with pytest.raises(DataError, match="frame 3 is damaged"):
        write_sequence(replace(whole, read=read), tmp_path / "new" / "drive")
    assert list((tmp_path / "new").iterdir()) == []


def test_existing_files_are_kept_and_an_empty_folder_is_filled(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("keep")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match="a new or an empty folder"):
        write_sequence(_sequence(CAMERA, far_m=5.0), tmp_path / "full")
    with pytest.raises(DataError, match="got a file"):
        write_sequence(_sequence(CAMERA, far_m=5.0), tmp_path / "full" / "mine.txt")
    assert (tmp_path / "full" / "mine.txt").read_text() == "keep"
    write_sequence(_sequence(CAMERA, far_m=5.0), tmp_path / "empty")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["empty", "full"]
    assert len(generic(tmp_path / "empty")) == 5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"projection": replace(CAMERA, fx=21.0)}, "frame 2: expected Pinhole"),
        ({"sensor_height_m": 2.0}, "frame 2: expected a sensor height of None"),
        ({"mask": np.ones((16, 24), dtype=bool)}, "frame 2: expected a frame without a mask"),
        ({"ranges_m": np.full((16, 24), 700.0)}, "655"),
        ({"ranges_m": np.full((16, 24), 0.0001)}, "expected ranges from 0.001"),
    ],
)
def test_frames_that_a_recording_cannot_hold_are_refused(tmp_path, change, message):
    whole = _sequence(CAMERA, far_m=5.0)
    odd = replace(whole, read=lambda i: whole[i].replace(**change) if i == 2 else whole[i])
    with pytest.raises(DataError, match=message):
        write_sequence(odd, tmp_path / "odd")
    assert list(tmp_path.iterdir()) == []


def test_laser_rows_and_empty_sequences_are_refused(tmp_path):
    row = LaserRow(10, -0.5, 0.1)
    laser = RangeSequence("laser", lambda i: RangeImage(np.ones((1, 10)), row), 3, "laser")
    with pytest.raises(DataError, match="expected pinhole or spherical frames"):
        write_sequence(laser, tmp_path / "laser")
    with pytest.raises(DataError, match="at least one frame"):
        write_sequence(replace(laser, length=0), tmp_path / "none")
    assert list(tmp_path.iterdir()) == []


def test_poses_that_are_not_finite_are_refused(tmp_path):
    whole = _sequence(CAMERA, far_m=5.0)
    poses = whole.poses.copy()
    poses[1, 0, 3] = np.nan
    with pytest.raises(DataError, match="finite"):
        write_sequence(replace(whole, poses=poses), tmp_path / "nan")
    assert list(tmp_path.iterdir()) == []


def _image(ranges_m, projection=CAMERA, sensor_height_m=None):
    return RangeImage(ranges_m, projection, sensor_height_m=sensor_height_m)


def _sequence(projection, far_m, sensor_height_m=None, n=5):
    """Frames of random ranges with holes, and poses that turn level about 'up'."""
    rng = np.random.default_rng(0)
    ranges_m = rng.uniform(0.5, far_m, (n, projection.height, projection.width))
    ranges_m[rng.random(ranges_m.shape) < 0.1] = np.nan
    angles = rng.uniform(-3, 3, n)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 0], poses[:, 0, 1] = np.cos(angles), -np.sin(angles)
    poses[:, 1, 0], poses[:, 1, 1] = np.sin(angles), np.cos(angles)
    poses[:, :3, 3] = rng.normal(0, 30, (n, 3))
    return RangeSequence(
        "random",
        lambda i: _image(ranges_m[i], projection, sensor_height_m),
        n,
        "street",
        poses,
        simulated=True,
    )


def _fields(folder):
    return json.loads((folder / "camera.json").read_text())
