"""``depthprint loops`` with poses or odometry: the pose graph and the trajectories it leaves."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from cli_support import run, write_recording
from depthprint.io.poses import read_kitti_poses, read_tum_poses, write_kitti_poses
from depthprint.pose_graph import read_g2o

SCENES = [0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2]


def poses(step_m: float) -> np.ndarray:
    made = np.tile(np.eye(4), (len(SCENES), 1, 1))
    made[:, 2, 3] = step_m * np.array(SCENES)
    return made


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = write_recording(tmp_path_factory.mktemp("graph") / "recording", SCENES)
    write_kitti_poses(folder / "poses.txt", poses(10.0))
    return folder


def loops(recording: Path, out: Path, *more: object) -> tuple[dict, str]:
    status, _, stderr = run("loops", recording, "--gap", 3, "--threshold", 1e-6, "-o", out, *more)
    assert status == 0, stderr
    return json.loads((out / "results.json").read_text()), stderr


def test_poses_and_verified_loops_become_a_graph(recording: Path, tmp_path: Path) -> None:
    pytest.importorskip("small_gicp")
    results, _ = loops(recording, tmp_path / "out")
    assert results["graph"] == {"nodes": 11, "odometry_edges": 10, "loop_edges": 3, "loops_refused": 0}
    graph = read_g2o(tmp_path / "out" / "graph.g2o")
    assert [(edge.first, edge.second) for edge in graph.loops] == [(0, 8), (1, 9), (2, 10)]
    for edge in graph.loops:  # the same scene from the same place
        np.testing.assert_allclose(edge.T_first_second, np.eye(4), atol=1e-3)
    np.testing.assert_allclose(graph.poses, poses(10.0), atol=1e-12)
    np.testing.assert_array_equal(read_kitti_poses(tmp_path / "out" / "trajectory_kitti.txt"), poses(10.0))
    stamps, again = read_tum_poses(tmp_path / "out" / "trajectory_tum.txt")
    np.testing.assert_array_equal(stamps, np.arange(11))
    np.testing.assert_allclose(again, poses(10.0), atol=1e-12)


def test_a_graph_of_odometry_says_what_it_lacks_without_small_gicp(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    odometry = tmp_path / "odometry.txt"
    write_kitti_poses(odometry, poses(11.0))
    results, stderr = loops(recording, tmp_path / "out", "--odometry", odometry)
    assert results["methods"]["emd"]["recall_at_1"] == 1.0
    assert results["graph"]["loop_edges"] is None
    graph = read_g2o(tmp_path / "out" / "graph.g2o")
    np.testing.assert_allclose(graph.poses, poses(11.0), atol=1e-12)
    assert not graph.loops
    assert "depthprint: note: graph.g2o holds no loops" in stderr
    assert "depthprint[slam]" in stderr


def test_odometry_of_another_length_is_refused(recording: Path, tmp_path: Path) -> None:
    write_kitti_poses(tmp_path / "odometry.txt", poses(11.0)[:5])
    status, _, stderr = run(
        "loops", recording, "--gap", 3, "--odometry", tmp_path / "odometry.txt", "-o", tmp_path / "out"
    )
    assert status == 2
    assert "odometry.txt: expected 11 poses, one a frame, got 5" in stderr
    assert [path.name for path in tmp_path.iterdir()] == ["odometry.txt"]
