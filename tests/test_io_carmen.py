"""CARMEN logs: fields, angles, no-return readings, damaged lines, and the two real logs."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from depthprint.errors import DataError, SettingsError
from depthprint.io.carmen import read_carmen_log


def flaser(ranges: list[float], pose: tuple[float, ...] = (1, 2, 0.5), stamp: float = 7.0) -> str:
    fields = [len(ranges), *ranges, *pose, 9, 9, 9, stamp, "robot", stamp + 1]
    return "FLASER " + " ".join(map(str, fields)) + "\n"


def robotlaser(ranges: list[float], farthest: float = 20.0) -> str:
    head = [0, -1.0, 2.0, 0.25, farthest, 0.01, 0, len(ranges)]
    tail = [2, 0.5, 0.5, 3, 4, 0.1, 9, 9, 9, 0, 0, 1, 1, 1, 12.5, "robot", 13.0]
    return "ROBOTLASER1 " + " ".join(map(str, [*head, *ranges, *tail])) + "\n"


def rawlaser(ranges: list[float]) -> str:
    return (
        "RAWLASER1 "
        + " ".join(map(str, [0, -1.0, 2.0, 0.25, 20.0, 0.01, 0, len(ranges), *ranges, 0, 3.5, "robot", 4]))
        + "\n"
    )


def write(path: Path, *lines: str) -> Path:
    path.write_text("".join(lines))
    return path


def test_flaser_gives_ranges_laser_pose_and_stamp(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.log",
        "# a comment\n",
        "ODOM 1 2 3 0 0 0 1.0 robot 1.0\n",
        flaser([1.0, 2.0, 0.0, 4.0]),
        "\n",
        flaser([5, 6, 7, 8], (0, 0, 0), 8.0),
    )
    log = read_carmen_log(path)
    np.testing.assert_array_equal(log.ranges_m, np.array([[1, 2, np.nan, 4], [5, 6, 7, 8]], np.float32))
    np.testing.assert_array_equal(log.poses_2d, [[1, 2, 0.5], [0, 0, 0]])
    np.testing.assert_array_equal(log.stamps_s, [7.0, 8.0])
    assert log.max_range_m == math.inf
    assert log.image(1).stamp_s == 8.0
    np.testing.assert_allclose(log.poses()[0] @ [1, 0, 0, 1], [1 + math.cos(0.5), 2 + math.sin(0.5), 0, 1])
    with pytest.raises(ValueError, match="read-only"):
        log.ranges_m[0, 0] = 3
    with pytest.raises(IndexError):
        log.image(2)


@pytest.mark.parametrize(("beams", "step_deg"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
def test_flaser_angles_follow_from_the_number_of_beams(tmp_path: Path, beams: int, step_deg: float) -> None:
    log = read_carmen_log(write(tmp_path / "a.log", flaser([2.0] * beams)), max_range_m=math.inf)
    assert log.angle_min_rad == pytest.approx(-math.pi / 2)
    assert math.degrees(log.angle_step_rad) == pytest.approx(step_deg)
    points = log.image(0).points()[0]
    np.testing.assert_allclose(points[0], [0, -2, 0], atol=1e-6)  # the first beam looks to the right
    np.testing.assert_allclose(points[beams // 2], [2, 0, 0], atol=1e-6)


def test_robotlaser_states_its_own_angles_and_range(tmp_path: Path) -> None:
    log = read_carmen_log(write(tmp_path / "a.log", robotlaser([1, 2, 19.9, 20.0, 25.0])))
    np.testing.assert_array_equal(log.ranges_m, np.array([[1, 2, 19.9, np.nan, np.nan]], np.float32))
    np.testing.assert_array_equal(log.poses_2d, [[3, 4, 0.1]])
    assert (log.angle_min_rad, log.angle_step_rad, log.stamps_s[0]) == (-1.0, 0.25, 12.5)


def test_raw_scans_have_no_poses(tmp_path: Path) -> None:
    log = read_carmen_log(write(tmp_path / "a.log", rawlaser([1, 2, 3])))
    assert log.poses_2d is None
    assert log.stamps_s[0] == 3.5
    with pytest.raises(DataError, match=r"a\.log: expected scans with poses"):
        log.poses()


def test_the_kind_of_message_can_be_chosen(tmp_path: Path) -> None:
    path = write(tmp_path / "a.log", rawlaser([1, 2, 3]), flaser([4, 5]), robotlaser([6]))
    assert read_carmen_log(path).ranges_m.shape == (1, 2)
    assert read_carmen_log(path, message="ROBOTLASER1").ranges_m.shape == (1, 1)
    assert read_carmen_log(path, message="RAWLASER1").ranges_m.shape == (1, 3)
    with pytest.raises(SettingsError, match="expected one of FLASER"):
        read_carmen_log(path, message="ODOM")


def test_what_counts_as_no_return(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    scans = [[*rng.uniform(1, 30, 40).round(2), 50.05, 50.05, 50.1, 50.05] for _ in range(20)]
    lines = [flaser(scan) for scan in scans]
    found = read_carmen_log(write(tmp_path / "pile.log", *lines))
    assert 49.5 < found.max_range_m < 50.05
    assert np.isnan(found.ranges_m[:, 40:]).all()
    assert np.isfinite(found.ranges_m[:, :40]).all()
    stated = read_carmen_log(
        write(tmp_path / "stated.log", "PARAM robot_front_laser_max 25.0 1 r 1\n", *lines)
    )
    assert stated.max_range_m == 25.0
    assert np.nanmax(stated.ranges_m) < 25.0
    kept = read_carmen_log(tmp_path / "pile.log", max_range_m=math.inf)
    assert np.isfinite(kept.ranges_m).all()
    spread = read_carmen_log(write(tmp_path / "spread.log", *(flaser(scan[:40]) for scan in scans)))
    assert spread.max_range_m == math.inf
    with pytest.raises(SettingsError, match="positive number"):
        read_carmen_log(tmp_path / "pile.log", max_range_m=-1.0)


def test_stamps_that_do_not_increase_are_not_given_to_images(tmp_path: Path) -> None:
    log = read_carmen_log(write(tmp_path / "a.log", flaser([1, 2], stamp=3), flaser([1, 2], stamp=2)))
    assert not log.stamps_increase
    assert log.image(0).stamp_s is None
    assert log.image(0).source.endswith("a.log, scan 0")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("ODOM 1 2 3\n", "with FLASER, ROBOTLASER1, RAWLASER1 messages"),
        (flaser([1, 2, 3])[:-30] + "\n", "line 1: expected 14 fields or more, got a cut"),
        ("# x\nFLASER\n", "line 2: expected 2 fields"),
        ("FLASER many 1 2\n", "line 1: expected a count, got 'many'"),
        ("FLASER -4 1 2\n", "line 1: expected a count of at least 1"),
        (flaser([1.0]), "at least two beams"),
        (flaser([1, 2]).replace(" 2 ", " two ", 2), "line 1: expected a count"),
        (flaser([1, 2]) + flaser([1, 2, 3]), "line 2: expected 2 beams"),
        (flaser([1, 2], (math.nan, 0, 0)), "line 1: expected a finite pose"),
        (flaser([1, 2]).replace("0.5", "half"), "line 1: expected numbers"),
    ],
)
def test_damaged_logs_are_refused_by_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(DataError, match=rf"a\.log.*{message}"):
        read_carmen_log(write(tmp_path / "a.log", text))


def test_gzipped_logs_are_read_and_cut_ones_refused(tmp_path: Path) -> None:
    packed = gzip.compress((flaser([1, 2, 3]) * 50).encode())
    (tmp_path / "a.log.gz").write_bytes(packed)
    assert len(read_carmen_log(tmp_path / "a.log.gz")) == 50
    (tmp_path / "cut.log.gz").write_bytes(packed[: len(packed) // 2])
    with pytest.raises(DataError, match=r"cut\.log\.gz: expected a whole gzip file"):
        read_carmen_log(tmp_path / "cut.log.gz")


def test_the_real_campus_log(data_root: Path) -> None:
    log = read_carmen_log(data_root / "laser" / "freiburg-campus-corrected.log.gz")
    assert log.ranges_m.shape == (2008, 360)
    assert math.degrees(log.angle_step_rad) == pytest.approx(0.5)
    assert log.max_range_m == 80.99  # stated by the log; 81.83 and 81.91 are its codes for nothing seen
    assert 0.25 < np.isnan(log.ranges_m).mean() < 0.27
    travelled_m = np.linalg.norm(np.diff(log.poses()[:, :2, 3], axis=0), axis=1).sum()
    assert 1700 < travelled_m < 1800


def test_the_real_corridor_log(data_root: Path) -> None:
    log = read_carmen_log(data_root / "laser" / "infinite-corridor-corrected.log.gz")
    assert log.ranges_m.shape == (1941, 180)
    assert math.degrees(log.angle_step_rad) == pytest.approx(1.0)
    assert 50.5 < log.max_range_m < 51.05  # the codes lie from 51.05 to 51.16
    assert 0.013 < np.isnan(log.ranges_m).mean() < 0.014
    assert not log.stamps_increase


@pytest.mark.parametrize("name", ["infinite-corridor", "freiburg-campus"])
def test_consecutive_real_scans_agree_by_their_poses_only_when_beams_run_from_right_to_left(
    data_root: Path, name: str
) -> None:
    log = read_carmen_log(data_root / "laser" / f"{name}-corrected.log.gz")
    poses = log.poses()

    def world(i: int, mirrored: bool) -> np.ndarray:
        points = log.image(i).points()[0].astype(float)
        points = points[np.isfinite(points).all(axis=1)]
        if mirrored:
            points[:, 1] *= -1
        return (points @ poses[i, :3, :3].T + poses[i, :3, 3])[:, :2]

    def typical_gap_m(mirrored: bool) -> float:
        gaps = []
        for i in range(100, 1900, 40):
            a, b = world(i, mirrored), world(i + 1, mirrored)
            gaps.append(np.median(np.linalg.norm(a[:, None] - b[None], axis=-1).min(axis=1)))
        return float(np.median(gaps))

    assert typical_gap_m(mirrored=False) < 0.15
    assert typical_gap_m(mirrored=True) > 0.2
