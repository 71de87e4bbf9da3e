"""KITTI odometry: small trees in the published layout, and the real scans where they are."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from depthprint.datasets import open_sequence
from depthprint.datasets.kitti_calibration import read_kitti_calibration
from depthprint.datasets.kitti_odometry import kitti_odometry
from depthprint.errors import DataError, SettingsError
from depthprint.io.poses import write_kitti_poses
from depthprint.io.velodyne import write_velodyne_bin
from depthprint.projection import Pinhole, Spherical

FX, CX, CY, BASELINE_M, COLOUR_OFFSET_M = 200.0, 95.5, 39.5, 0.5, 0.06
SIZE = (80, 192)
DISPARITY_PX = 10.0


def turned(yaw_rad: float, x: float, z: float) -> np.ndarray:
    """Pose of a KITTI camera (y down) that stands at x, z and looks along yaw."""
    pose = np.eye(4)
    pose[0, 0] = pose[2, 2] = np.cos(yaw_rad)
    pose[0, 2], pose[2, 0] = np.sin(yaw_rad), -np.sin(yaw_rad)
    pose[:3, 3] = x, 0.0, z
    return pose


POSES = np.array([turned(0.1 * i, 2.0 * i, 5.0 * i) for i in range(4)])
TR = np.array([[0.0, -1, 0, -0.01], [0, 0, -1, -0.08], [1, 0, 0, -0.27]])


def calibration_text() -> str:
    rows = []
    for camera, offset_m in enumerate((0.0, -BASELINE_M, COLOUR_OFFSET_M, COLOUR_OFFSET_M - BASELINE_M)):
        P = np.array([[FX, 0, CX, FX * offset_m], [0, FX, CY, 0], [0, 0, 1, 0]])
        rows.append(f"P{camera}: " + " ".join(f"{v:.12e}" for v in P.ravel()))
    rows.append("Tr: " + " ".join(f"{v:.12e}" for v in TR.ravel()))
    return "\n".join(rows) + "\n"


def write_pair(folder: Path, frame: int, cameras: tuple[int, int], colour: bool) -> None:
    rng = np.random.default_rng(frame)
    texture = cv2.GaussianBlur(rng.integers(0, 255, (SIZE[0], SIZE[1] + 40)).astype(np.float32), (3, 3), 0)
    shift = int(DISPARITY_PX)
    for camera, left in zip(cameras, (True, False), strict=True):
        start = 20 if left else 20 + shift
        image = texture[:, start : start + SIZE[1]].astype(np.uint8)
        if colour:
            image = np.repeat(image[..., None], 3, axis=2)
        target = folder / f"image_{camera}"
        target.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(target / f"{frame:06d}.png"), image)


def write_scan(folder: Path, frame: int) -> None:
    """A wall 12 m ahead of the scanner."""
    y, z = np.meshgrid(np.linspace(-4, 4, 60), np.linspace(-2, 0.3, 40))
    scan = np.column_stack([np.full(y.size, 12.0), y.ravel(), z.ravel(), np.zeros(y.size)])
    folder.mkdir(parents=True, exist_ok=True)
    write_velodyne_bin(folder / f"{frame:06d}.bin", scan.astype(np.float32))


@pytest.fixture
def tree(tmp_path):
    """Sequence 07 with a grey pair, scans, calibration, times and poses of four frames."""
    folder = tmp_path / "sequences" / "07"
    for frame in range(4):
        write_pair(folder, frame, (0, 1), colour=False)
        write_scan(folder / "velodyne", frame)
    (folder / "calib.txt").write_text(calibration_text())
    (folder / "times.txt").write_text("".join(f"{0.1 * i:.6e}\n" for i in range(4)))
    (tmp_path / "poses").mkdir()
    write_kitti_poses(tmp_path / "poses" / "07.txt", POSES)
    return tmp_path


def test_stereo_pair_gives_metric_depth_and_the_cameras_poses(tree):
    sequence = kitti_odometry(tree, "07")
    assert (len(sequence), sequence.preset, sequence.name) == (4, "street", "kitti_odometry/07 stereo")
    assert (sequence.truth.gap, sequence.truth.heading_deg, sequence.world_up) == (
        100,
        45.0,
        (0.0, -1.0, 0.0),
    )
    np.testing.assert_allclose(sequence.poses, POSES, atol=1e-12)
    image = sequence[2]
    assert image.projection == Pinhole(FX, FX, CX, CY, SIZE[1], SIZE[0])
    assert (image.sensor_height_m, image.stamp_s) == (1.65, pytest.approx(0.2))
    assert image.source.endswith("000002.png")
    np.testing.assert_allclose(np.nanmedian(image.ranges_m), FX * BASELINE_M / DISPARITY_PX, rtol=0.01)


def test_colour_pair_stands_beside_camera_0(tree):
    folder = tree / "sequences" / "07"
    for camera in (0, 1):
        for file in (folder / f"image_{camera}").iterdir():
            file.unlink()
        (folder / f"image_{camera}").rmdir()
    for frame in range(4):
        write_pair(folder, frame, (2, 3), colour=True)
    sequence = kitti_odometry(tree, "07", "stereo")
    centre_in_cam0 = np.linalg.inv(POSES[3]) @ sequence.poses[3]
    np.testing.assert_allclose(centre_in_cam0[:3, 3], [-COLOUR_OFFSET_M, 0, 0], atol=1e-9)
    np.testing.assert_allclose(np.nanmedian(sequence[0].ranges_m), FX * BASELINE_M / DISPARITY_PX, rtol=0.01)


def test_scans_are_ranges_about_the_scanner_with_its_own_poses(tree):
    sequence = kitti_odometry(tree, "07", "velodyne", lidar_width=512)
    assert (sequence.preset, sequence.truth.heading_deg) == ("lidar", None)
    image = sequence[1]
    assert isinstance(image.projection, Spherical)
    assert (image.projection.width, image.projection.height, image.sensor_height_m) == (512, 64, 1.73)
    ahead = image.points()[image.valid]
    np.testing.assert_allclose(np.median(ahead[:, 0]), 12.0, atol=0.2)
    expected = POSES[1] @ np.vstack([TR, [0, 0, 0, 1]])
    np.testing.assert_allclose(sequence.poses[1], expected, atol=1e-12)
    forward_in_world = sequence.poses[1][:3, :3] @ [1.0, 0, 0]
    np.testing.assert_allclose(forward_in_world, POSES[1][:3, 2], atol=1e-12)


def test_layout_is_found_from_root_parent_and_sequence_folder(tree):
    (tree / "dataset").mkdir()
    for name in ("sequences", "poses"):
        (tree / name).rename(tree / "dataset" / name)
    folder = tree / "dataset" / "sequences" / "07"
    for path in (tree, tree / "dataset", tree / "dataset" / "sequences", folder):
        sequence = open_sequence(path)
        assert sequence.name == "kitti_odometry/07 stereo"
        np.testing.assert_allclose(sequence.poses, POSES, atol=1e-12)
    assert open_sequence(tree, sequence="07", source="velodyne").preset == "lidar"


def test_sparse_scans_take_their_poses_by_frame_number(tree):
    folder = tree / "sequences" / "07"
    (folder / "velodyne" / "000001.bin").unlink()
    sequence = kitti_odometry(folder, source="velodyne")
    expected = POSES[[0, 2, 3]] @ np.vstack([TR, [0, 0, 0, 1]])
    np.testing.assert_allclose(sequence.poses, expected, atol=1e-12)
    assert sequence[1].source.endswith("000002.bin")
    assert sequence[1].stamp_s == pytest.approx(0.2)


def test_every_other_frame_halves_the_gap(tree):
    sequence = kitti_odometry(tree, "07", every=2)
    assert (len(sequence), sequence.truth.gap) == (2, 50)
    np.testing.assert_allclose(sequence.poses, POSES[::2], atol=1e-12)


def test_sequences_without_published_poses_have_none(tree):
    (tree / "poses" / "07.txt").unlink()
    assert kitti_odometry(tree).poses is None


def test_poses_inside_the_sequence_folder_serve_too(tree):
    (tree / "poses" / "07.txt").rename(tree / "sequences" / "07" / "poses.txt")
    np.testing.assert_allclose(kitti_odometry(tree).poses, POSES, atol=1e-12)


def test_too_few_poses_name_both_counts_and_files(tree):
    write_kitti_poses(tree / "poses" / "07.txt", POSES[:3])
    with pytest.raises(DataError, match=r"07.txt: 3 poses, but .*times.txt has 4 times"):
        kitti_odometry(tree)
    (tree / "sequences" / "07" / "times.txt").unlink()
    with pytest.raises(DataError, match=r"07.txt: 3 poses, but .*frames up to number 000003"):
        kitti_odometry(tree)


def test_unequal_image_pairs_name_the_odd_frame(tree):
    (tree / "sequences" / "07" / "image_1" / "000002.png").unlink()
    with pytest.raises(DataError, match="4 images in image_0 but 3 in image_1; frame 000002"):
        kitti_odometry(tree)


def test_stereo_needs_a_calibration_with_both_cameras(tree):
    calib = tree / "sequences" / "07" / "calib.txt"
    calib.write_text("\n".join(r for r in calibration_text().splitlines() if not r.startswith("P1")))
    with pytest.raises(DataError, match=r"calib.txt: expected a row P1, got P0, P2, P3, Tr"):
        kitti_odometry(tree)
    calib.unlink()
    with pytest.raises(DataError, match=r"calib.txt: missing; stereo depth needs"):
        kitti_odometry(tree)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("P0: 1 2 3", "line 1: expected 'name: 12 finite numbers'"),
        ("P0: " + "x " * 12, "line 1: expected numbers"),
        ("P0: " + "nan " * 12, "line 1: expected 'name: 12 finite"),
        ("1 0 0 0 0 1 0 0 0 0 1 0", "line 1"),
    ],
)
def test_malformed_calibration_names_its_line(tmp_path, row, message):
    (tmp_path / "calib.txt").write_text(row)
    with pytest.raises(DataError, match=message):
        read_kitti_calibration(tmp_path / "calib.txt")


def test_swapped_cameras_are_refused(tree):
    calibration = read_kitti_calibration(tree / "sequences" / "07" / "calib.txt")
    with pytest.raises(DataError, match="camera 0 right of 1"):
        calibration.rig(1, 0)


def test_damaged_and_odd_sized_images_are_named(tree):
    sequence = kitti_odometry(tree)
    folder = tree / "sequences" / "07"
    cut = folder / "image_0" / "000001.png"
    cut.write_bytes(cut.read_bytes()[:-30])
    with pytest.raises(DataError, match=r"000001.png: .*truncated"):
        sequence[1]
    for camera in (0, 1):
        cv2.imwrite(str(folder / f"image_{camera}" / "000002.png"), np.zeros((40, 50), np.uint8))
    with pytest.raises(DataError, match=r"000002.png"):
        sequence[2]
    deep = folder / "image_0" / "000003.png"
    cv2.imwrite(str(deep), np.zeros(SIZE, np.uint16))
    with pytest.raises(DataError, match=r"000003.png: expected an 8-bit PNG image, got one of 16 bits"):
        sequence[3]


def test_wrong_times_are_named(tree):
    (tree / "sequences" / "07" / "times.txt").write_text("0.0\n0.1\n")
    with pytest.raises(DataError, match=r"times.txt: .* up to 000003, got 2"):
        kitti_odometry(tree)


def test_unknown_sequence_source_and_layout_raise(tree, tmp_path_factory):
    with pytest.raises(DataError, match="expected sequence '05', got 07"):
        kitti_odometry(tree, "05")
    with pytest.raises(SettingsError, match="is itself a sequence folder"):
        kitti_odometry(tree / "sequences" / "07", "05")
    with pytest.raises(SettingsError, match="'stereo' or 'velodyne', got 'radar'"):
        kitti_odometry(tree, source="radar")
    with pytest.raises(DataError, match="no such folder"):
        kitti_odometry(tree / "absent")
    empty = tmp_path_factory.mktemp("empty")
    with pytest.raises(DataError, match="expected a folder 'sequences'"):
        kitti_odometry(empty)
    (empty / "velodyne").mkdir()
    with pytest.raises(DataError, match=r"expected XXXXXX.bin files, got none"):
        kitti_odometry(empty)


def test_real_scans_of_one_place_lie_near_each_other(data_root):
    sequence = open_sequence(data_root / "kitti_odometry", sequence="00")
    assert (len(sequence), sequence.preset) == (9, "lidar")
    by_name = {Path(sequence[i].source).stem: i for i in range(len(sequence))}
    position = sequence.poses[:, [0, 2], 3]
    same = np.linalg.norm(position[by_name["000052"]] - position[by_name["004501"]])
    other = np.linalg.norm(position[by_name["000088"]] - position[by_name["000850"]])
    assert same < 4 < 300 < other
    ground = sequence[0].points()[sequence[0].valid]
    assert abs(np.percentile(ground[:, 2], 10) + 1.73) < 0.3


def test_real_opposite_directions_face_each_other(data_root):
    sequence = open_sequence(data_root / "kitti_odometry", sequence="08")
    forward = sequence.poses[:, :3, 0]
    assert len(sequence) == 2
    assert forward[0] @ forward[1] < -np.cos(np.radians(45))
