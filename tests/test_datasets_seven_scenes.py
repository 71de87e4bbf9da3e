"""7-Scenes and CARMEN logs: small trees in the published layouts, and the real data where it is."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from depthprint.datasets import open_sequence
from depthprint.datasets.carmen_laser import carmen_laser
from depthprint.datasets.seven_scenes import seven_scenes
from depthprint.errors import DataError, SettingsError
from depthprint.io.depth_image import write_depth_png
from depthprint.io.poses import write_matrix_poses
from depthprint.projection import LaserRow, Pinhole

SIZE = (12, 16)


def pose(x: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[0, 3] = x
    return matrix


def write_sequence(folder, numbers, size=SIZE):
    folder.mkdir(parents=True, exist_ok=True)
    for n in numbers:
        write_depth_png(folder / f"frame-{n:06d}.depth.png", np.full(size, 1.0 + n / 1000))
        write_matrix_poses(folder / f"frame-{n:06d}.pose.txt", pose(n)[None])
    np.savetxt(folder / "camera-intrinsics.txt", [[500.0, 0, 8], [0, 501, 6], [0, 0, 1]])
    return folder


def test_frames_poses_and_intrinsics_of_a_folder(tmp_path):
    sequence = seven_scenes(write_sequence(tmp_path / "kitchen", [0, 2, 4, 6]))
    assert (sequence.name, sequence.preset, len(sequence)) == ("seven_scenes/kitchen", "handheld", 4)
    assert (sequence.truth.kind, sequence.truth.positive, sequence.truth.negative) == ("overlap", 0.5, 0.3)
    assert sequence.truth.gap == 50
    np.testing.assert_array_equal(sequence.poses[:, 0, 3], [0, 2, 4, 6])
    image = sequence[1]
    assert image.projection == Pinhole(500, 501, 8, 6, 16, 12)
    np.testing.assert_allclose(image.ranges_m, 1.002)
    assert image.source.endswith("frame-000002.depth.png")
    with pytest.raises(IndexError):
        sequence[4]


def test_thinning_keeps_the_gap_in_time(tmp_path):
    folder = write_sequence(tmp_path / "kitchen", range(8))
    assert seven_scenes(folder).truth.gap == 100
    thinned = seven_scenes(folder, every=4)
    assert (len(thinned), thinned.truth.gap) == (2, 25)
    np.testing.assert_array_equal(thinned.poses[:, 0, 3], [0, 4])


def test_scene_of_several_sequences_needs_a_name(tmp_path):
    for name in ("seq-01", "seq-02"):
        write_sequence(tmp_path / "chess" / name, [0, 1])
    with pytest.raises(DataError, match="one of seq-01, seq-02"):
        open_sequence(tmp_path / "chess")
    for given in ("2", "02", "seq-02"):
        assert open_sequence(tmp_path / "chess", sequence=given).name == "seven_scenes/chess/seq-02"
    with pytest.raises(DataError, match="expected sequence '3' among seq-01, seq-02"):
        seven_scenes(tmp_path / "chess", "3")
    with pytest.raises(SettingsError, match="is itself a sequence folder"):
        seven_scenes(tmp_path / "chess" / "seq-01", "02")


def test_scene_of_one_sequence_needs_none(tmp_path):
    write_sequence(tmp_path / "chess" / "seq-05", [0, 1])
    assert len(open_sequence(tmp_path / "chess")) == 2


def test_published_camera_is_taken_without_intrinsics(tmp_path):
    folder = write_sequence(tmp_path / "office", [0], size=(480, 640))
    (folder / "camera-intrinsics.txt").unlink()
    assert seven_scenes(folder)[0].projection == Pinhole(585, 585, 320, 240, 640, 480)


def test_frames_without_any_pose_have_no_poses(tmp_path):
    folder = write_sequence(tmp_path / "office", [0, 1])
    for file in folder.glob("*.pose.txt"):
        file.unlink()
    assert seven_scenes(folder).poses is None


def test_wrong_pose_count_and_nan_pose_are_named(tmp_path):
    folder = write_sequence(tmp_path / "office", [0, 1, 2])
    (folder / "frame-000001.pose.txt").unlink()
    with pytest.raises(DataError, match=r"frame-000001.pose.txt: missing; 3 frames have 2 poses"):
        seven_scenes(folder)
    np.savetxt(folder / "frame-000001.pose.txt", np.full((4, 4), np.nan))
    with pytest.raises(DataError, match=r"frame-000001.pose.txt"):
        seven_scenes(folder)


def test_frame_of_another_size_is_named(tmp_path):
    folder = write_sequence(tmp_path / "office", [0, 1])
    write_depth_png(folder / "frame-000001.depth.png", np.ones((5, 5)))
    sequence = seven_scenes(folder)
    assert sequence[0].ranges_m.shape == SIZE
    with pytest.raises(DataError, match=r"frame-000001.depth.png"):
        sequence[1]


@pytest.mark.parametrize("content", ["1 2 3", "a b c", "0 0 0\n0 1 0\n0 0 1", "1 0 nan\n0 1 0\n0 0 1"])
def test_malformed_intrinsics_are_named(tmp_path, content):
    folder = write_sequence(tmp_path / "office", [0])
    (folder / "camera-intrinsics.txt").write_text(content)
    with pytest.raises(DataError, match=r"camera-intrinsics.txt"):
        seven_scenes(folder)


def test_folder_without_frames_raises(tmp_path):
    with pytest.raises(DataError, match="or seq-XX folders of them, got neither"):
        seven_scenes(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        seven_scenes(tmp_path / "absent")


def test_real_kitchen(data_root):
    sequence = open_sequence(data_root / "rgbd" / "redkitchen_seq01")
    assert (len(sequence), sequence.truth.gap, sequence.truth.kind) == (500, 50, "overlap")
    assert sequence.poses.shape == (500, 4, 4)
    image = sequence[250]
    assert image.ranges_m.shape == (480, 640)
    assert 0.5 < np.nanmedian(image.ranges_m) < 5
    assert 0.5 < image.valid.mean() < 1


def flaser(ranges, x, y, theta, stamp) -> str:
    values = " ".join(f"{r:.2f}" for r in ranges)
    return f"FLASER {len(ranges)} {values} {x} {y} {theta} {x} {y} {theta} {stamp} host {stamp}\n"


def write_log(path, count=6, beams=180):
    text = "".join(flaser(np.full(beams, 2.0 + i), i, 2 * i, 0.25 * i, 10.0 + i) for i in range(count))
    with gzip.open(path, "wt") if path.suffix == ".gz" else path.open("w") as file:
        file.write(text)
    return path


@pytest.mark.parametrize("name", ["yard.log", "yard.log.gz"])
def test_log_gives_rows_with_planar_poses(tmp_path, name):
    sequence = open_sequence(write_log(tmp_path / name))
    assert (sequence.name, sequence.preset, len(sequence)) == ("carmen_laser/yard", "laser", 6)
    assert sequence.world_up == (0.0, 0.0, 1.0)
    image = sequence[3]
    assert image.ranges_m.shape == (1, 180)
    np.testing.assert_allclose(image.ranges_m, 5.0)
    assert isinstance(image.projection, LaserRow)
    np.testing.assert_allclose(sequence.poses[3][:3, 3], [3, 6, 0])
    np.testing.assert_allclose(sequence.poses[3][:3, 0], [np.cos(0.75), np.sin(0.75), 0])


def test_loops_are_counted_closer_indoors(tmp_path):
    outdoor = carmen_laser(write_log(tmp_path / "campus.log")).truth
    indoor = carmen_laser(write_log(tmp_path / "infinite-corridor.log")).truth
    assert (outdoor.positive, outdoor.negative, outdoor.gap) == (4.0, 10.0, 100)
    assert (indoor.positive, indoor.negative, indoor.heading_deg) == (2.0, 5.0, 45.0)
    assert carmen_laser(tmp_path / "campus.log", indoor=True).truth == indoor
    assert carmen_laser(tmp_path / "infinite-corridor.log", indoor=False).truth == outdoor


def test_thinned_log_keeps_pairs_of_scan_and_pose(tmp_path):
    sequence = carmen_laser(write_log(tmp_path / "yard.log"), every=4)
    assert (len(sequence), sequence.truth.gap) == (2, 25)
    np.testing.assert_allclose(sequence[1].ranges_m, 6.0)
    np.testing.assert_allclose(sequence.poses[1][:2, 3], [4, 8])
    with pytest.raises(SettingsError, match="every"):
        carmen_laser(tmp_path / "yard.log", every=0)


@pytest.mark.parametrize(
    ("name", "count", "beams", "positive"),
    [("freiburg-campus-corrected", 2008, 360, 4.0), ("infinite-corridor-corrected", 1941, 180, 2.0)],
)
def test_real_logs(data_root, name, count, beams, positive):
    sequence = open_sequence(data_root / "laser" / f"{name}.log.gz")
    assert (len(sequence), sequence.truth.positive) == (count, positive)
    assert sequence[count // 2].ranges_m.shape == (1, beams)
    assert sequence.poses.shape == (count, 4, 4)
