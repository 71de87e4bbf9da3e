from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.errors import DataError, SettingsError
from depthprint.evaluation.ground_truth import (
    TruthMatrix,
    horizontal_basis,
    horizontal_headings,
    loop_ground_truth,
    read_loop_matrix,
)
from depthprint.evaluation.view_overlap import view_overlaps
from depthprint.projection import LaserRow, Pinhole
from depthprint.range_image import RangeImage

LASER = LaserRow(3, -0.1, 0.1)
CAMERA = Pinhole(40.0, 40.0, 31.5, 23.5, 64, 48)


def laser_sequence(xyyaw: list[tuple[float, float, float]], **changes) -> RangeSequence:
    poses = np.tile(np.eye(4), (len(xyyaw), 1, 1))
    for pose, (x, y, yaw_deg) in zip(poses, xyyaw, strict=True):
        c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
        pose[:2, :2] = [[c, -s], [s, c]]
        pose[:2, 3] = x, y
    blank = RangeImage(np.ones((1, 3), dtype=np.float32), LASER)
    return replace(RangeSequence("made", lambda i: blank, len(poses), "laser", poses), **changes)


def camera_sequence(depths: list[np.ndarray], poses: np.ndarray) -> RangeSequence:
    images = [RangeImage(np.asarray(d, dtype=np.float32), CAMERA) for d in depths]
    return RangeSequence("made", images.__getitem__, len(images), "handheld", poses)


def test_distance_truth_has_three_values_and_the_gap():
    sequence = laser_sequence([(0, 0, 0), (7, 0, 0), (20, 0, 0), (1, 0, 0)])
    truth = loop_ground_truth(sequence, LoopTruth(gap=1))
    assert truth.values.tolist() == [[0, 0, 0, 0], [0, 0, 0, 0], [-1, 0, 0, 0], [1, 0, 0, 0]]
    assert [truth.candidates(i) for i in range(4)] == [0, 0, 1, 2]
    assert truth.has_positive.tolist() == [False, False, False, True]
    counts = truth.counts()
    assert counts["queries"] == 2
    assert (counts["positive_pairs"], counts["ignored_pairs"], counts["negative_pairs"]) == (1, 1, 1)
    with pytest.raises(ValueError, match="read-only"):
        truth.values[3, 0] = 0


def test_opposite_heading_nearby_is_ignored_and_far_away_negative():
    sequence = laser_sequence([(0, 0, 0), (0, 0, 44), (0, 0, 46), (0, 0, 180), (50, 0, 180)])
    rule = LoopTruth(gap=0, heading_deg=45.0)
    assert loop_ground_truth(sequence, rule).values[:, 0].tolist() == [0, 1, 0, 0, -1]
    assert loop_ground_truth(sequence, replace(rule, heading_deg=None)).values[:, 0].tolist() == [
        0,
        1,
        1,
        1,
        -1,
    ]


def test_height_does_not_count_as_distance():
    sequence = laser_sequence([(0, 0, 0), (1, 0, 0)])
    assert sequence.poses is not None
    sequence.poses[1, 2, 3] = 100.0
    assert loop_ground_truth(sequence, LoopTruth(gap=0)).values[1, 0] == 1
    tilted = replace(sequence, world_up=(1.0, 0.0, 0.0))
    assert loop_ground_truth(tilted, LoopTruth(gap=0, heading_deg=None)).values[1, 0] == -1


def test_horizontal_basis_of_the_kitti_world_is_right_and_forward():
    assert_allclose(horizontal_basis((0.0, -1.0, 0.0)), [[1, 0, 0], [0, 0, 1]], atol=1e-12)


def test_heading_of_a_camera_is_its_optical_axis():
    poses = np.eye(4)[None].copy()
    sequence = replace(camera_sequence([np.ones((48, 64))], poses), world_up=(0.0, -1.0, 0.0))
    assert_allclose(horizontal_headings(sequence), [[0, 1]], atol=1e-12)
    with pytest.raises(DataError, match="frame 0"):
        horizontal_headings(replace(sequence, world_up=(0.0, 0.0, 1.0)))


def test_missing_and_broken_poses_are_named():
    sequence = laser_sequence([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    with pytest.raises(DataError, match="needs poses"):
        loop_ground_truth(replace(sequence, poses=None))
    assert sequence.poses is not None
    sequence.poses[2, 0, 3] = np.nan
    with pytest.raises(DataError, match="frame 2"):
        loop_ground_truth(sequence)


@pytest.mark.parametrize(
    "rule",
    [
        LoopTruth(kind="near"),
        LoopTruth(gap=-1),
        LoopTruth(positive=5, negative=4),
        LoopTruth(heading_deg=0),
        LoopTruth(kind="overlap", positive=0.3, negative=0.5),
        LoopTruth(kind="overlap", positive=0.5, negative=0.3, overlap_tolerance_m=0),
    ],
)
def test_impossible_rules_are_refused(rule):
    with pytest.raises(SettingsError, match="LoopTruth"):
        loop_ground_truth(laser_sequence([(0, 0, 0), (1, 0, 0)]), rule)


def slow_share(
    source: np.ndarray, target: np.ndarray, T_target_source: np.ndarray, tolerance_m: float
) -> float:
    seen = confirmed = 0
    for v in range(CAMERA.height):
        for u in range(CAMERA.width):
            z = source[v, u]
            if not np.isfinite(z):
                continue
            seen += 1
            ray = np.array([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, 1.0])
            x, y, z_new = T_target_source[:3, :3] @ (ray * z) + T_target_source[:3, 3]
            if z_new <= 0:
                continue
            u_new = math.floor(CAMERA.fx * x / z_new + CAMERA.cx + 0.5)
            v_new = math.floor(CAMERA.fy * y / z_new + CAMERA.cy + 0.5)
            inside = 0 <= u_new < CAMERA.width and 0 <= v_new < CAMERA.height
            confirmed += inside and abs(target[v_new, u_new] - z_new) <= tolerance_m
    return confirmed / seen if seen else 0.0


def test_overlap_equals_a_slow_reference():
    generator = np.random.default_rng(2)
    depths, poses = [], np.tile(np.eye(4), (5, 1, 1))
    for k in range(5):
        depth = 2 + 0.3 * np.sin(np.arange(64) / 9 + k) + 0.05 * generator.random((48, 64))
        depth[generator.random((48, 64)) < 0.1] = np.nan
        depths.append(depth.astype(np.float32))
        angle = 0.2 * k
        poses[k, :3, :3] = [
            [math.cos(angle), 0, math.sin(angle)],
            [0, 1, 0],
            [-math.sin(angle), 0, math.cos(angle)],
        ]
        poses[k, :3, 3] = 0.1 * k, -0.05 * k, 0.02 * k
    shares = view_overlaps(camera_sequence(depths, poses), gap=0, tolerance_m=0.1)
    for i in range(1, 5):
        for j in range(i):
            there = np.linalg.inv(poses[j]) @ poses[i]
            assert shares.forward[i, j] == pytest.approx(
                slow_share(depths[i], depths[j], there, 0.1), abs=2e-3
            )
            back = np.linalg.inv(there)
            assert shares.backward[i, j] == pytest.approx(
                slow_share(depths[j], depths[i], back, 0.1), abs=2e-3
            )
    assert 0.05 < shares.forward[2, 0] < 0.95


def test_overlap_is_full_on_the_same_view_and_none_behind_a_wall():
    wall = np.full((48, 64), 2.0)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[2, 2, 3] = 10.0
    shares = view_overlaps(camera_sequence([wall, wall, wall], poses), gap=0)
    assert shares.forward[1, 0] == shares.backward[1, 0] == 1.0
    assert shares.forward[2, 0] == shares.backward[2, 0] == 0.0


def test_point_hidden_in_the_other_view_is_not_overlap():
    far = np.full((48, 64), 4.0)
    screened = far.copy()
    screened[:, :32] = 1.0
    shares = view_overlaps(camera_sequence([far, screened], np.tile(np.eye(4), (2, 1, 1))), gap=0)
    assert shares.forward[1, 0] == shares.backward[1, 0] == 0.5


def test_close_up_is_ignored_since_it_shows_the_place():
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 2, 3] = 3.0
    sequence = camera_sequence([np.full((48, 64), 4.0), np.full((48, 64), 1.0)], poses)
    shares = view_overlaps(sequence, gap=0)
    assert shares.forward[1, 0] == 1.0
    assert shares.backward[1, 0] < 0.1
    rule = LoopTruth(kind="overlap", gap=0, positive=0.5, negative=0.3)
    assert loop_ground_truth(sequence, rule).values[1, 0] == 0


def test_image_without_returns_overlaps_with_nothing():
    poses = np.tile(np.eye(4), (2, 1, 1))
    shares = view_overlaps(camera_sequence([np.full((48, 64), np.nan), np.ones((48, 64))], poses), gap=0)
    assert shares.forward[1, 0] == shares.backward[1, 0] == 0.0


def test_overlap_of_a_laser_row_is_refused():
    with pytest.raises(SettingsError, match="pinhole"):
        view_overlaps(laser_sequence([(0, 0, 0), (0, 0, 0)]), gap=0)


def test_progress_reaches_its_total():
    calls: list[tuple[int, int]] = []
    poses = np.tile(np.eye(4), (3, 1, 1))
    view_overlaps(
        camera_sequence([np.ones((48, 64))] * 3, poses), 0, progress=lambda d, t: calls.append((d, t))
    )
    assert calls[-1][0] == calls[-1][1]
    assert [d for d, _ in calls] == sorted(d for d, _ in calls)


def test_published_loop_matrix_is_read(data_root):
    truth = read_loop_matrix(data_root / "kitti_odometry" / "loops" / "06.mat")
    assert truth.values.shape == (1101, 1101)
    assert truth.counts()["positive_pairs"] == 3287
    assert truth.counts()["ignored_pairs"] == 0


def test_real_path_has_the_known_number_of_loops(data_root):
    rows = np.loadtxt(data_root / "kitti_odometry" / "poses" / "00.txt").reshape(-1, 3, 4)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows
    blank = RangeImage(np.ones((48, 64), dtype=np.float32), CAMERA)
    sequence = RangeSequence(
        "kitti 00", lambda i: blank, len(poses), "street", poses, world_up=(0.0, -1.0, 0.0)
    )
    any_heading = LoopTruth(gap=99, heading_deg=None)
    assert loop_ground_truth(sequence, any_heading).counts()["positive_queries"] == 791
    assert 700 < loop_ground_truth(sequence).counts()["positive_queries"] < 791


def test_damaged_loop_matrices_are_named(tmp_path):
    from scipy.io import savemat

    broken = tmp_path / "broken.mat"
    broken.write_bytes(b"no matlab file" * 40)
    with pytest.raises(DataError, match=r"broken\.mat"):
        read_loop_matrix(broken)
    with pytest.raises(DataError, match="no such file"):
        read_loop_matrix(tmp_path / "absent.mat")
    savemat(tmp_path / "wide.mat", {"truth": np.zeros((3, 4))})
    with pytest.raises(DataError, match=r"truth \(3, 4\)"):
        read_loop_matrix(tmp_path / "wide.mat")
    savemat(tmp_path / "grey.mat", {"truth": np.full((3, 3), 7)})
    with pytest.raises(DataError, match="0 and 1"):
        read_loop_matrix(tmp_path / "grey.mat")


def test_truth_matrix_keeps_candidates_only():
    truth = TruthMatrix(np.ones((4, 4), dtype=np.int8), gap=1, rule="all")
    assert truth.values.tolist() == [[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0]]
    with pytest.raises(DataError, match="square"):
        TruthMatrix(np.zeros((2, 3), dtype=np.int8), 1, "")
    with pytest.raises(DataError, match="1, 0 and -1"):
        TruthMatrix(np.full((2, 2), 5, dtype=np.int8), 0, "")
