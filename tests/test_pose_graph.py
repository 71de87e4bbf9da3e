"""Pose graphs: the chain of odometry, g2o that GTSAM reads alike, optimisation that wrong loops do not bend."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from depthprint.errors import DataError, MissingExtraError, SettingsError
from depthprint.evaluation.trajectory import absolute_trajectory_error
from depthprint.pose_graph import (
    Edge,
    EdgeNoise,
    Node,
    PoseGraph,
    graph_from_odometry,
    inverse_pose,
    optimize_pose_graph,
    read_g2o,
    write_g2o,
)
from depthprint.simulation.odometry import OdometryNoise, simulate_odometry

STEP = EdgeNoise(0.05, 0.01)
LOOP = EdgeNoise(0.02, 0.005)
# No error of scale: on a circle that is driven twice no loop can tell it.
DRIFT = OdometryNoise(translation=0.01, heading_rad=0.005, scale=0.0, heading_bias_rad=0.001)


@dataclass(frozen=True)
class Loop:
    """What the graph asks of a detector's result."""

    query: int
    match: int | None
    accepted: bool
    T_match_query: np.ndarray | None = None


def some_poses(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = Rotation.random(n, random_state=seed).as_matrix()
    poses[:, :3, 3] = rng.normal(0, 30, (n, 3))
    return poses


def rounds(n: int = 60, turns: int = 2) -> np.ndarray:
    """Poses on a circle of 20 m that is driven several times: frame i + n / turns is where frame i was."""
    angles = 2 * np.pi * turns * np.arange(n) / n
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("z", angles + np.pi / 2).as_matrix()
    poses[:, :2, 3] = 20 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return poses


def true_loops(poses: np.ndarray, every: int = 5) -> list[Edge]:
    half = len(poses) // 2
    return [
        Edge(i, i + half, inverse_pose(poses[i]) @ poses[i + half], LOOP.information, loop=True)
        for i in range(0, half, every)
    ]


def wrong_loops(poses: np.ndarray) -> list[Edge]:
    return [Edge(i, i + 12, np.eye(4), LOOP.information, loop=True) for i in (3, 17, 31)]


def test_odometry_becomes_a_chain_that_leads_along_it():
    poses = some_poses(5)
    graph = graph_from_odometry(poses, STEP, numbers=[2, 3, 5, 8, 13])
    np.testing.assert_array_equal(graph.poses, poses)
    assert [(e.first, e.second, e.loop) for e in graph.edges] == [
        (2, 3, False),
        (3, 5, False),
        (5, 8, False),
        (8, 13, False),
    ]
    here = poses[0]
    for edge, pose in zip(graph.edges, poses[1:], strict=True):
        here = here @ edge.T_first_second
        np.testing.assert_allclose(here, pose, atol=1e-12)
    assert graph_from_odometry(np.empty((0, 4, 4)), STEP) == PoseGraph((), ())


def test_the_noise_of_each_step_may_differ():
    noises = [EdgeNoise(0.1 * n, 0.01) for n in (1, 2)]
    graph = graph_from_odometry(some_poses(3), noises)
    assert [round(float(e.information[0, 0]), 9) for e in graph.edges] == [100.0, 25.0]
    np.testing.assert_allclose(np.diag(graph.edges[0].information)[3:], 1e4)


def test_only_accepted_loops_with_a_relative_pose_become_edges():
    T = some_poses(1, seed=4)[0]
    results = [Loop(0, None, False), Loop(3, 1, True), Loop(4, 1, True, T), Loop(5, 1, False, T)]
    graph = graph_from_odometry(some_poses(6), STEP).with_loops(results, LOOP)
    assert [(e.first, e.second) for e in graph.loops] == [(1, 4)]
    np.testing.assert_array_equal(graph.loops[0].T_first_second, T)
    np.testing.assert_array_equal(graph.loops[0].information, LOOP.information)
    with pytest.raises(DataError, match="1-4"):
        graph_from_odometry(some_poses(3), STEP).with_loops(results, LOOP)


@settings(max_examples=25, deadline=None)
@given(n=st.integers(2, 7), seed=st.integers(0, 2**31))
def test_a_graph_comes_back_from_g2o(tmp_path_factory, n, seed):
    path = tmp_path_factory.getbasetemp() / "graph.g2o"
    half = np.random.default_rng(seed).normal(0, 3, (6, 6))
    edge = Edge(0, n - 1, some_poses(1, seed)[0], half @ half.T + np.eye(6), loop=n > 2)
    graph = graph_from_odometry(some_poses(n, seed), STEP).with_edges([edge])
    write_g2o(path, graph)
    again = read_g2o(path)
    np.testing.assert_allclose(again.poses, graph.poses, atol=1e-12)
    assert [node.number for node in again.nodes] == [node.number for node in graph.nodes]
    for found, written in zip(again.edges, graph.edges, strict=True):
        assert (found.first, found.second, found.loop) == (written.first, written.second, written.loop)
        np.testing.assert_allclose(found.T_first_second, written.T_first_second, atol=1e-12)
        np.testing.assert_array_equal(found.information, written.information)


def test_gtsam_reads_the_same_graph_from_g2o(tmp_path: Path):
    gtsam = pytest.importorskip("gtsam")
    poses = some_poses(4)
    noise = EdgeNoise(0.5, 0.02)
    half = np.random.default_rng(1).normal(0, 3, (6, 6))
    edge = Edge(0, 3, some_poses(1, 9)[0], half @ half.T + np.eye(6), loop=True)
    graph = graph_from_odometry(poses, noise).with_edges([edge])
    write_g2o(tmp_path / "graph.g2o", graph)
    factors, values = gtsam.readG2o(str(tmp_path / "graph.g2o"), True)
    for node in graph.nodes:
        np.testing.assert_allclose(values.atPose3(node.number).matrix(), node.T_world_sensor, atol=1e-9)
    assert factors.size() == len(graph.edges)
    rotation_first = [3, 4, 5, 0, 1, 2]
    for number, written in enumerate(graph.edges):
        factor = factors.at(number)
        assert list(factor.keys()) == [written.first, written.second]
        np.testing.assert_allclose(factor.measured().matrix(), written.T_first_second, atol=1e-9)
        information = factor.noiseModel().information()
        np.testing.assert_allclose(
            information, written.information[np.ix_(rotation_first, rotation_first)], rtol=1e-9
        )


def test_what_gtsam_writes_is_read(tmp_path: Path):
    gtsam = pytest.importorskip("gtsam")
    poses = some_poses(3, seed=2)
    values, factors = gtsam.Values(), gtsam.NonlinearFactorGraph()
    for number, pose in enumerate(poses):
        values.insert(number, gtsam.Pose3(pose))
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.01, 0.02, 0.04, 0.1, 0.2, 0.4]))
    factors.add(gtsam.BetweenFactorPose3(0, 2, gtsam.Pose3(poses[1]), noise))
    gtsam.writeG2o(factors, values, str(tmp_path / "graph.g2o"))
    graph = read_g2o(tmp_path / "graph.g2o")
    np.testing.assert_allclose(graph.poses, poses, atol=1e-4)
    np.testing.assert_allclose(graph.edges[0].T_first_second, poses[1], atol=1e-4)
    np.testing.assert_allclose(
        np.diag(graph.edges[0].information), [100, 25, 6.25, 10000, 2500, 625], rtol=1e-4
    )
    assert graph.edges[0].loop


VERTICES = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 1 0 0 0 0 0 1\n"
EDGE = "EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1"
UPPER = " 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"


def test_comments_blank_lines_and_fixed_vertices_are_passed_over(tmp_path: Path):
    (tmp_path / "a.g2o").write_text(f"# by hand\n{VERTICES}\nFIX 0\n{EDGE}{UPPER}\n")
    graph = read_g2o(tmp_path / "a.g2o")
    assert len(graph.nodes) == 2
    assert not graph.edges[0].loop
    np.testing.assert_array_equal(graph.edges[0].information, np.eye(6))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (VERTICES + "VERTEX_SE2 0 0 0 0\n", "line 3: expected VERTEX_SE3:QUAT.* got 'VERTEX_SE2'"),
        (VERTICES + "VERTEX_SE3:QUAT 1 1 0 0 0 0 0 1\n", "line 3: .*got 1 again"),
        (VERTICES + EDGE + "\n", "line 3: expected 30 numbers, got 9"),
        (VERTICES + EDGE + UPPER.replace(" 1", " x", 1) + "\n", "line 3: expected numbers"),
        (VERTICES + EDGE + UPPER.replace(" 1", " -1", 1) + "\n", "line 3: .*positive definite"),
        (VERTICES + EDGE + UPPER.replace(" 1", " nan", 1) + "\n", "line 3: .*finite information"),
        (VERTICES + EDGE.replace("0 0 0 1", "0 0 0 2") + UPPER + "\n", "line 3: .*unit quaternion"),
        (VERTICES.replace("0 0 0 0 0 0 1", "inf 0 0 0 0 0 1", 1), "line 1: .*finite numbers"),
        (VERTICES + EDGE.replace("QUAT 0 1", "QUAT 0 7") + UPPER + "\n", "got none for 7"),
        ("", "empty"),
        ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 \xe9\n", "ASCII"),
    ],
)
def test_what_is_no_g2o_is_refused_by_file_and_line(tmp_path: Path, text: str, message: str):
    (tmp_path / "a.g2o").write_text(text, encoding="latin-1")
    with pytest.raises(DataError, match=rf"a\.g2o.*{message}"):
        read_g2o(tmp_path / "a.g2o")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Node(0, np.full((4, 4), np.nan)), "node 0"),
        (lambda: Node(0, 2 * np.eye(4)), "node 0"),
        (lambda: Edge(0, 1, np.eye(4), np.eye(3)), r"edge 0-1: .*\(6, 6\)"),
        (lambda: Edge(0, 1, np.eye(4), np.triu(np.ones((6, 6)))), "edge 0-1: .*symmetric"),
        (lambda: Edge(0, 1, np.eye(4), np.zeros((6, 6))), "edge 0-1: .*positive definite"),
        (lambda: PoseGraph((Node(1, np.eye(4)), Node(1, np.eye(4))), ()), "rising number"),
        (lambda: PoseGraph((Node(1, np.eye(4)),), (Edge(1, 2, np.eye(4), np.eye(6)),)), "1-2"),
        (lambda: PoseGraph((Node(1, np.eye(4)),), (Edge(1, 1, np.eye(4), np.eye(6)),)), "1-1"),
        (lambda: graph_from_odometry(some_poses(3), STEP).with_poses(some_poses(2)), "3 poses, got 2"),
    ],
)
def test_parts_that_do_not_fit_are_named(make, message):
    with pytest.raises(DataError, match=message):
        make()


@pytest.mark.parametrize("values", [(0.0, 1.0), (1.0, -1.0), (np.nan, 1.0), (1.0, np.inf)])
def test_noise_is_positive(values):
    with pytest.raises(SettingsError, match="EdgeNoise"):
        EdgeNoise(*values)


def test_as_many_noises_as_steps():
    with pytest.raises(SettingsError, match="3 numbers and one noise, or 2, got 3 and 1"):
        graph_from_odometry(some_poses(3), [STEP])
    with pytest.raises(SettingsError, match="got 2 and 2"):
        graph_from_odometry(some_poses(3), STEP, numbers=[0, 1])


def test_what_is_in_a_graph_cannot_be_written_to():
    graph = graph_from_odometry(some_poses(3), STEP)
    for array in (graph.nodes[0].T_world_sensor, graph.edges[0].T_first_second, graph.edges[0].information):
        assert not array.flags.writeable


@pytest.mark.parametrize("loss", ["gnc", "cauchy", "huber", "squared"])
def test_right_loops_take_the_drift_away(loss):
    pytest.importorskip("gtsam")
    poses = rounds()
    drifted = simulate_odometry(poses, DRIFT, seed=3)
    graph = graph_from_odometry(drifted, STEP).with_edges(true_loops(poses))
    done = optimize_pose_graph(graph, loss=loss)
    before, after = (absolute_trajectory_error(p, poses) for p in (drifted, done.graph.poses))
    assert after < 0.1 * before
    assert done.final_error < 0.3 * done.initial_error
    assert done.loop_weights.shape == (len(graph.loops),)
    assert (done.loop_weights > 0.5).all()
    np.testing.assert_allclose(done.graph.poses[0], drifted[0], atol=1e-6)
    assert done.graph.edges == graph.edges


def test_wrong_loops_bend_only_the_squared_loss():
    pytest.importorskip("gtsam")
    poses = rounds()
    drifted = simulate_odometry(poses, DRIFT, seed=3)
    right, wrong = true_loops(poses), wrong_loops(poses)
    graph = graph_from_odometry(drifted, STEP).with_edges(right + wrong)
    errors, weights = {}, {}
    for loss in ("gnc", "cauchy", "squared"):
        done = optimize_pose_graph(graph, loss=loss)
        errors[loss] = absolute_trajectory_error(done.graph.poses, poses)
        weights[loss] = done.loop_weights
    assert errors["gnc"] < 0.5 * absolute_trajectory_error(drifted, poses) < errors["squared"]
    assert errors["cauchy"] < errors["squared"]
    np.testing.assert_allclose(weights["gnc"], [1.0] * len(right) + [0.0] * len(wrong), atol=1e-3)
    assert weights["cauchy"][: len(right)].min() > 10 * weights["cauchy"][len(right) :].max()


def test_the_optimum_of_a_small_graph_is_that_of_scipy():
    pytest.importorskip("gtsam")
    from scipy.optimize import least_squares

    poses = rounds(8, 1)
    drifted = simulate_odometry(poses, OdometryNoise(translation=0.3, heading_rad=0.02), seed=1)
    drifted[:, 2, 3] = 0.0
    loop = Edge(0, 7, inverse_pose(poses[0]) @ poses[7], LOOP.information, loop=True)
    graph = graph_from_odometry(drifted, STEP).with_edges([loop])

    def residuals(x: np.ndarray) -> np.ndarray:
        """Planar: positions and headings of all nodes but the first."""
        moved = drifted.copy()
        moved[1:, :2, 3] = x.reshape(-1, 3)[:, :2]
        moved[1:, :3, :3] = Rotation.from_euler("z", x.reshape(-1, 3)[:, 2]).as_matrix()
        rows = []
        for edge in graph.edges:
            error = inverse_pose(edge.T_first_second) @ inverse_pose(moved[edge.first]) @ moved[edge.second]
            turn = Rotation.from_matrix(error[:3, :3]).as_rotvec()
            # GTSAM measures the difference in the tangent space of SE(3).
            V = np.linalg.inv(_left_jacobian(turn))
            rows.append(np.sqrt(np.diag(edge.information)) * np.concatenate([V @ error[:3, 3], turn]))
        return np.concatenate(rows)

    headings = Rotation.from_matrix(drifted[1:, :3, :3]).as_euler("zyx")[:, 0]
    start = np.concatenate([drifted[1:, :2, 3], headings[:, None]], axis=1).ravel()
    expected = least_squares(residuals, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    done = optimize_pose_graph(graph, loss="squared", max_iterations=200)
    assert done.final_error == pytest.approx(expected.cost, rel=1e-3)
    np.testing.assert_allclose(done.graph.poses[1:, :2, 3], expected.x.reshape(-1, 3)[:, :2], atol=0.02)


def _left_jacobian(turn: np.ndarray) -> np.ndarray:
    angle = float(np.linalg.norm(turn))
    if angle < 1e-9:
        return np.eye(3)
    x, y, z = turn / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + (1 - np.cos(angle)) / angle * K + (1 - np.sin(angle) / angle) * K @ K


def test_a_graph_that_cannot_be_optimised_is_refused():
    graph = graph_from_odometry(some_poses(3), STEP)
    with pytest.raises(SettingsError, match="loss: expected one of gnc"):
        optimize_pose_graph(graph, loss="tukey")
    with pytest.raises(SettingsError, match="max_iterations"):
        optimize_pose_graph(graph, max_iterations=0)
    with pytest.raises(SettingsError, match="at least two nodes"):
        optimize_pose_graph(graph_from_odometry(some_poses(1), STEP))


def test_without_gtsam_the_pip_line_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'depthprint\[slam\]'"):
        optimize_pose_graph(graph_from_odometry(some_poses(3), STEP))
