"""A folder of frames of any known kind, its camera and its poses; and which data set a path looks like."""

from __future__ import annotations

import json
import logging

import numpy as np
import pytest

from depthprint.datasets import SEQUENCES, guess_dataset, open_objects, open_sequence, require_frames
from depthprint.datasets.base import RangeSequence
from depthprint.datasets.camera_file import read_camera_file
from depthprint.datasets.generic import generic
from depthprint.errors import DataError, SettingsError
from depthprint.io.depth_image import write_depth_npy, write_depth_png
from depthprint.io.pcd import write_pcd
from depthprint.io.ply import write_ply
from depthprint.io.point_cloud import PointCloud
from depthprint.io.poses import write_kitti_poses, write_tum_poses
from depthprint.io.velodyne import write_velodyne_bin
from depthprint.projection import Pinhole, Spherical
from depthprint.range_image import RangeImage

SIZE = (12, 16)
CAMERA = {"fx": 14.0, "fy": 14.0, "cx": 7.5, "cy": 5.5, "width": 16, "height": 12}


def poses(count: int) -> np.ndarray:
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, 0, 3] = np.arange(count)
    return matrices


@pytest.fixture
def depth_folder(tmp_path):
    """Frames 1, 2, ..., 10, 11 (not zero-padded), each at a depth of its number in tenths of a metre."""
    folder = tmp_path / "walk"
    for i in range(1, 12):
        write_depth_png(folder / f"depth{i}.png", np.full(SIZE, i / 10))
    return folder


def test_frames_come_in_natural_order(depth_folder):
    sequence = generic(depth_folder, **CAMERA)
    assert (sequence.name, len(sequence), sequence.poses) == ("generic/walk", 11, None)
    assert [round(float(sequence[i].ranges_m[0, 0]), 1) for i in range(11)] == [i / 10 for i in range(1, 12)]


def test_camera_file_gives_projection_scale_and_preset(depth_folder):
    (depth_folder / "camera.json").write_text(
        json.dumps({**CAMERA, "depth_scale_m": 0.01, "sensor_height_m": 1.2})
    )
    sequence = generic(depth_folder)
    image = sequence[0]
    assert image.projection == Pinhole(14, 14, 7.5, 5.5, 16, 12)
    np.testing.assert_allclose(image.ranges_m, 1.0)
    assert (image.sensor_height_m, sequence.preset, sequence.truth.kind) == (1.2, "street", "distance")
    assert sequence.truth.heading_deg == 45.0


def test_options_go_before_the_camera_file(depth_folder):
    (depth_folder / "camera.json").write_text(json.dumps(CAMERA))
    assert generic(depth_folder).preset == "handheld"
    overridden = generic(depth_folder, fx=20.0, sensor_height_m=0.5)
    assert (overridden[0].projection.fx, overridden[0].projection.fy, overridden.preset) == (20, 14, "street")


def test_folder_without_any_camera_works_and_says_so(depth_folder, caplog):
    with caplog.at_level(logging.WARNING, logger="depthprint"):
        sequence = open_sequence(depth_folder)
    assert "assuming a Kinect-like camera" in caplog.text
    assert "walk" in caplog.text
    projection = sequence[0].projection
    across = 2 * np.degrees(np.arctan(projection.width / 2 / projection.fx))
    assert 57 < across < 58
    assert (sequence.preset, sequence.truth.kind, sequence.poses) == ("handheld", "overlap", None)


def test_incomplete_camera_names_what_is_missing(depth_folder):
    with pytest.raises(DataError, match=r"camera options: a pinhole camera needs .* missing cx, cy"):
        generic(depth_folder, fx=14.0, fy=14.0)


@pytest.mark.parametrize("form", ["kitti", "tum"])
def test_poses_of_either_form(depth_folder, form):
    stamps_s = 100 + 0.5 * np.arange(11)
    if form == "kitti":
        write_kitti_poses(depth_folder / "poses.txt", poses(11))
    else:
        write_tum_poses(depth_folder / "poses.txt", stamps_s, poses(11))
    sequence = generic(depth_folder, every=5, **CAMERA)
    np.testing.assert_allclose(sequence.poses, poses(11)[::5], atol=1e-12)
    assert sequence[1].stamp_s == (None if form == "kitti" else 102.5)
    np.testing.assert_allclose(sequence[1].ranges_m, 0.6)
    assert not sequence.poses.flags.writeable


def test_poses_from_another_file(depth_folder, tmp_path):
    write_kitti_poses(tmp_path / "path.txt", poses(11))
    assert generic(depth_folder, poses=tmp_path / "path.txt", **CAMERA).poses is not None
    with pytest.raises(DataError, match=r"absent.txt"):
        generic(depth_folder, poses=tmp_path / "absent.txt", **CAMERA)


@pytest.mark.parametrize(
    ("R", "up"),
    [
        (np.eye(3), (0.0, -1.0, 0.0)),
        (np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), (0.0, 0.0, 1.0)),
    ],
)
def test_world_up_is_the_axis_nearest_to_the_cameras_up(depth_folder, R, up):
    matrices = poses(11)
    lean = np.radians(20)
    tilt = np.array([[1, 0, 0], [0, np.cos(lean), -np.sin(lean)], [0, np.sin(lean), np.cos(lean)]])
    matrices[:, :3, :3] = R @ tilt
    write_kitti_poses(depth_folder / "poses.txt", matrices)
    assert generic(depth_folder, **CAMERA).world_up == up


def test_wrong_pose_count_names_both_counts(depth_folder):
    write_kitti_poses(depth_folder / "poses.txt", poses(10))
    with pytest.raises(DataError, match=r"poses.txt: expected one pose a frame, got 10 poses for 11 frames"):
        generic(depth_folder, **CAMERA)


def test_nan_pose_names_its_line(depth_folder):
    write_kitti_poses(depth_folder / "poses.txt", poses(11))
    rows = (depth_folder / "poses.txt").read_text().splitlines()
    rows[4] = " ".join(["nan"] * 12)
    (depth_folder / "poses.txt").write_text("\n".join(rows))
    with pytest.raises(DataError, match=r"poses.txt, line 5"):
        generic(depth_folder, **CAMERA)


def test_frame_of_another_size_is_named(depth_folder):
    write_depth_png(depth_folder / "depth7.png", np.ones((5, 6)))
    with pytest.raises(DataError, match=r"depth7.png: expected 16 x 12 pixels as in depth1.png, got 6 x 5"):
        generic(depth_folder, **CAMERA)[6]


def test_camera_of_another_size_is_named(depth_folder):
    with pytest.raises(DataError, match=r"depth1.png: camera options states width 99, got 16"):
        generic(depth_folder, **{**CAMERA, "width": 99})


def test_mixed_kinds_need_a_pattern(depth_folder):
    write_depth_npy(depth_folder / "cloud.npy", np.ones(SIZE))
    with pytest.raises(
        DataError, match=r"frames of one kind, got \*.npy, \*.png; choose with the option pattern"
    ):
        generic(depth_folder, **CAMERA)
    assert len(generic(depth_folder, pattern="*.png", **CAMERA)) == 11
    with pytest.raises(DataError, match=r"expected x\*.png files, got none"):
        generic(depth_folder, pattern="x*.png", **CAMERA)


def test_spherical_images(tmp_path):
    ranges = np.full((8, 32), 4.0, dtype=np.float32)
    for i in range(3):
        write_depth_npy(tmp_path / f"{i:03d}.npy", ranges)
    limits = {
        "azimuth_min_rad": -1.0,
        "azimuth_max_rad": 1.0,
        "elevation_min_rad": -0.4,
        "elevation_max_rad": 0.1,
    }
    (tmp_path / "camera.json").write_text(
        json.dumps({"projection": "spherical", "width": 32, "height": 8, "sensor_height_m": 1.7, **limits})
    )
    sequence = generic(tmp_path)
    assert sequence[2].projection == Spherical(32, 8, -1.0, 1.0, -0.4, 0.1)
    assert (sequence.preset, sequence.truth.heading_deg, sequence[0].sensor_height_m) == ("lidar", None, 1.7)


@pytest.mark.parametrize("suffix", [".bin", ".pcd", ".ply"])
def test_point_clouds_become_spherical_images(tmp_path, suffix):
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(4000, 3)) * [1, 1, 0.1]
    points = (7.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    for i in range(2):
        path = tmp_path / f"{i}{suffix}"
        if suffix == ".bin":
            write_velodyne_bin(path, np.column_stack([points, np.zeros(len(points), np.float32)]))
        else:
            (write_pcd if suffix == ".pcd" else write_ply)(path, PointCloud(points, len(points)))
    sequence = generic(tmp_path, width=180, height=16)
    image = sequence[1]
    assert (image.projection.width, image.projection.height, sequence.preset) == (180, 16, "lidar")
    assert image.valid.mean() > 0.3
    np.testing.assert_allclose(image.ranges_m[image.valid], 7.0, rtol=1e-5)


def test_point_clouds_of_a_camera(tmp_path):
    for i in range(2):
        write_pcd(tmp_path / f"{i}.pcd", PointCloud(np.array([[0, 0, 3.0]], np.float32), 1))
    image = generic(tmp_path, projection="pinhole", **CAMERA)[0]
    assert image.valid.sum() == 1
    np.testing.assert_allclose(np.nanmax(image.ranges_m), 3.0)
    with pytest.raises(DataError, match="need width and height"):
        generic(tmp_path, projection="pinhole", fx=1.0, fy=1.0, cx=1.0, cy=1.0)


def test_empty_and_absent_folders_raise(tmp_path):
    with pytest.raises(DataError, match=r"expected \*.png, .* files, got none"):
        generic(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        generic(tmp_path / "absent")


def test_single_frame_is_too_few_for_loops(tmp_path):
    write_depth_png(tmp_path / "only.png", np.ones(SIZE))
    sequence = generic(tmp_path, **CAMERA)
    with pytest.raises(DataError, match="expected at least 2 frames, got 1 frame"):
        require_frames(sequence)
    assert require_frames(sequence, 1) is sequence


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "expected JSON"),
        ("[1, 2]", "expected a JSON object, got list"),
        ('{"focal": 3}', "unknown field 'focal'"),
        ('{"fx": "wide"}', "fx: expected a finite number, got 'wide'"),
        ('{"fx": NaN}', "fx: expected a finite number"),
        ('{"fx": true}', "fx: expected a finite number"),
        ('{"fy": -1}', "fy: expected a positive number"),
        ('{"width": 3.5}', "width: expected a whole number"),
        ('{"depth_scale_m": 0}', "depth_scale_m: expected a positive number"),
        ('{"projection": "fisheye"}', "projection: expected 'pinhole' or 'spherical'"),
        ('{"simulated": 1}', "simulated: expected true or false"),
    ],
)
def test_malformed_camera_file_names_the_field(tmp_path, content, message):
    (tmp_path / "camera.json").write_text(content)
    with pytest.raises(DataError, match=r"camera.json: " + message):
        read_camera_file(tmp_path / "camera.json")


def test_absent_fields_may_be_null(tmp_path):
    (tmp_path / "camera.json").write_text('{"fx": 3, "sensor_height_m": null}')
    description = read_camera_file(tmp_path / "camera.json")
    assert (description.fx, description.sensor_height_m) == (3.0, None)


def test_simulated_data_stays_marked(depth_folder):
    (depth_folder / "camera.json").write_text(json.dumps({**CAMERA, "simulated": True}))
    assert generic(depth_folder).simulated
    assert generic(depth_folder, fx=20.0).simulated


def test_unknown_options_raise(depth_folder):
    with pytest.raises(SettingsError, match="camera options: unknown field 'focal'"):
        generic(depth_folder, focal=3.0)
    with pytest.raises(SettingsError, match="fx: expected a positive number"):
        generic(depth_folder, fx=-3.0)
    with pytest.raises(SettingsError, match="every: expected a whole number >= 1, got 0"):
        generic(depth_folder, every=0, **CAMERA)


def test_names_take_dashes_and_underscores(depth_folder, tmp_path):
    with pytest.raises(DataError, match="7-Scenes"):
        open_sequence(tmp_path / "absent", dataset="seven-scenes")
    with pytest.raises(SettingsError, match=r"expected one of carmen_laser, generic, .*, got 'nine-scenes'"):
        open_sequence(depth_folder, dataset="nine-scenes")
    with pytest.raises(SettingsError, match="uw_rgbd_object, got 'coil'"):
        open_objects(depth_folder, dataset="coil")
    assert "simulated_street" in SEQUENCES


def test_options_that_a_loader_lacks_raise(depth_folder, tmp_path):
    with pytest.raises(SettingsError, match="generic: has no sequences to choose from, got sequence '00'"):
        open_sequence(depth_folder, sequence="00")
    with pytest.raises(SettingsError, match="seven_scenes: expected options among sequence, every, got 'fx'"):
        open_sequence(depth_folder, dataset="seven_scenes", fx=3.0)
    with pytest.raises(SettingsError, match="seven_scenes: expected a path"):
        open_sequence(dataset="seven_scenes")
    with pytest.raises(SettingsError, match="got neither"):
        open_sequence()


def test_path_that_looks_like_nothing_lists_what_was_looked_for(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing")
    for path in (tmp_path, tmp_path / "notes.txt"):
        with pytest.raises(DataError, match=r"no known data set; looked for a CARMEN log .* \(generic\)"):
            guess_dataset(path)
    with pytest.raises(DataError, match="no such file or folder"):
        guess_dataset(tmp_path / "absent")


def test_objects_are_told_from_sequences(tmp_path):
    folder = tmp_path / "apple" / "apple_1"
    folder.mkdir(parents=True)
    (folder / "apple_1_1_1_depthcrop.png").write_bytes(b"")
    with pytest.raises(DataError, match="holds views of objects"):
        guess_dataset(tmp_path)


def test_simulated_street_is_data_like_any_other():
    pytest.importorskip("depthprint.datasets.simulated_street")
    with pytest.raises(SettingsError, match=r"simulated_street: expected options among .*, got 'colour'"):
        open_sequence(dataset="simulated-street", colour="red")


@pytest.mark.parametrize(
    "projection", [Pinhole(14.0, 14.0, 7.5, 5.5, 16, 12), Spherical(32, 8)], ids=["pinhole", "spherical"]
)
def test_written_sequences_are_read_back(tmp_path, projection):
    writer = pytest.importorskip("depthprint.simulation.writer")
    rng = np.random.default_rng(0)
    ranges_m = rng.integers(500, 9000, (3, projection.height, projection.width)) / 1000
    ranges_m[:, 2, 3] = np.nan
    images = [RangeImage(r, projection, sensor_height_m=1.7) for r in ranges_m]
    written = RangeSequence("made up", images.__getitem__, 3, "street", poses(3), simulated=True)
    writer.write_sequence(written, tmp_path / "written")
    sequence = open_sequence(tmp_path / "written")
    assert len(sequence) == 3
    for i in range(3):
        assert sequence[i].projection == projection
        assert sequence[i].sensor_height_m == 1.7
        np.testing.assert_allclose(sequence[i].ranges_m, ranges_m[i], atol=1e-3)
    np.testing.assert_allclose(sequence.poses, poses(3), atol=1e-9)
