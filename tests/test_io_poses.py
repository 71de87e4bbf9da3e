"""Poses: round trips of every form, and lines that are no pose refused by file and line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from depthprint.errors import DataError
from depthprint.io.poses import (
    check_poses,
    read_kitti_poses,
    read_matrix_poses,
    read_pose_files,
    read_poses,
    read_tum_poses,
    write_kitti_poses,
    write_matrix_poses,
    write_tum_poses,
)


def some_poses(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = Rotation.random(n, random_state=seed).as_matrix()
    poses[:, :3, 3] = rng.normal(0, 100, (n, 3))
    return poses


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 9), st.integers(0, 2**31))
def test_every_form_gives_back_what_was_written(tmp_path_factory, n: int, seed: int) -> None:
    folder = tmp_path_factory.getbasetemp()
    poses = some_poses(n, seed)
    write_kitti_poses(folder / "kitti.txt", poses)
    np.testing.assert_array_equal(read_poses(folder / "kitti.txt"), poses)
    write_matrix_poses(folder / "stacked.txt", poses)
    np.testing.assert_array_equal(read_poses(folder / "stacked.txt"), poses)
    stamps = 1.3e9 + np.arange(n) / 30
    write_tum_poses(folder / "tum.txt", stamps, poses)
    read_stamps, read_back = read_tum_poses(folder / "tum.txt")
    np.testing.assert_array_equal(read_stamps, stamps)
    np.testing.assert_allclose(read_back, poses, atol=1e-12)
    np.testing.assert_allclose(read_poses(folder / "tum.txt"), poses, atol=1e-12)


def test_tum_quaternions_hold_the_scalar_last(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("# stamp tx ty tz qx qy qz qw\n\n5.5 1 2 3 0 0 0.70710678 0.70710678\n")
    stamps, poses = read_tum_poses(tmp_path / "a.txt")
    assert stamps == [5.5]
    np.testing.assert_allclose(poses[0], [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-8)


def test_one_matrix_a_file_and_one_matrix_a_row(tmp_path: Path) -> None:
    poses = some_poses(3)
    paths = [tmp_path / f"{i}.pose.txt" for i in range(3)]
    for path, pose in zip(paths, poses, strict=True):
        np.savetxt(path, pose, fmt="%.17g", delimiter="\t")
    np.testing.assert_array_equal(read_pose_files(paths), poses)
    np.savetxt(tmp_path / "rows.txt", poses.reshape(3, 16), fmt="%.17g")
    np.testing.assert_array_equal(read_matrix_poses(tmp_path / "rows.txt"), poses)
    write_matrix_poses(paths[1], poses)
    with pytest.raises(DataError, match=r"1\.pose\.txt: expected one 4x4 matrix, got 3"):
        read_pose_files(paths)


IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (IDENTITY + "nan 0 0 0 0 1 0 0 0 0 1 0\n", "line 2: expected a pose of finite numbers"),
        (IDENTITY + "# cut\n1 0 0 0 0 1 0\n", "line 3: expected 12 columns, as before, got 7"),
        (IDENTITY + "1 0 0 0 0 1 0 0 0 0 1 x\n", "line 2: expected numbers"),
        (IDENTITY + "2 0 0 0 0 1 0 0 0 0 1 0\n", "line 2: expected a rotation matrix"),
        (IDENTITY + "1 0 0 0 0 1 0 0 0 0 -1 0\n", "line 2: expected a rotation matrix"),
        ("1 2 3 4 5\n", "line 1: expected 12 columns .* got 5"),
        ("# nothing\n", "expected at least one pose, got none"),
        ("", "got an empty one"),
        ("0 0 0 0 0 0 0 0.9\n", "line 1: .*unit quaternion"),
        ("0 0 0 nan 0 0 0 1\n", "line 1: expected finite numbers"),
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n", "expected four lines a matrix, got 3"),
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 1 1\n", "line 1: expected 0 0 0 1 as the last row"),
        ("1 0 0 0\n0 1 0 0\n0 0 inf 0\n0 0 0 1\n", "line 1: expected a pose of finite numbers"),
    ],
)
def test_what_is_no_pose_is_refused_by_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "poses.txt").write_text(text)
    with pytest.raises(DataError, match=rf"poses\.txt.*{message}"):
        read_poses(tmp_path / "poses.txt")


def test_a_reader_of_one_form_refuses_the_others(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(IDENTITY)
    for read in (read_tum_poses, read_matrix_poses):
        with pytest.raises(DataError, match="got 12"):
            read(tmp_path / "a.txt")
    (tmp_path / "b.txt").write_text("0 0 0 0 0 0 0 1\n")
    with pytest.raises(DataError, match=r"expected 12 columns \(KITTI poses\), got 8"):
        read_kitti_poses(tmp_path / "b.txt")


def test_poses_are_checked_before_they_are_written(tmp_path: Path) -> None:
    bad = some_poses(3)
    bad[1, 0, 3] = np.nan
    with pytest.raises(DataError, match=r"a\.txt, pose 1"):
        write_kitti_poses(tmp_path / "a.txt", bad)
    with pytest.raises(DataError, match="2 finite stamps"):
        write_tum_poses(tmp_path / "a.txt", [0.0], some_poses(2))
    with pytest.raises(DataError, match=r"shape \(n, 4, 4\)"):
        check_poses(np.eye(4))
    assert not list(tmp_path.iterdir())


def test_real_poses(data_root: Path) -> None:
    kitti = read_poses(data_root / "kitti_odometry" / "poses" / "07.txt")
    assert kitti.shape == (1101, 4, 4)
    travelled_m = np.linalg.norm(np.diff(kitti[:, :3, 3], axis=0), axis=1).sum()
    assert 690 < travelled_m < 700
    files = sorted((data_root / "rgbd" / "redkitchen_seq01").glob("*.pose.txt"))
    poses = read_pose_files(files)
    assert poses.shape == (500, 4, 4)
    np.testing.assert_array_equal(poses[3], np.loadtxt(files[3]))
