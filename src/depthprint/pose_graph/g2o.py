"""Pose graphs as g2o text: VERTEX_SE3:QUAT and EDGE_SE3:QUAT."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.io._files import read_bytes
from depthprint.io.atomic import atomic_path
from depthprint.pose_graph.graph import Edge, Node, PoseGraph

__all__ = ["read_g2o", "write_g2o"]

FloatArray = npt.NDArray[np.float64]

_VERTEX, _EDGE, _FIX = "VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", "FIX"
_UPPER = np.triu_indices(6)
_QUATERNION_TOLERANCE = 1e-3


def write_g2o(path: Path | str, graph: PoseGraph) -> None:
    """Write a graph; the first node is held fixed by a FIX line.

    A vertex is ``number x y z qx qy qz qw``; an edge ``first second`` with the same seven numbers of T_first_second and
    the upper triangle of its information, row by row, translation before rotation. The information of rotations is
    per squared radian, as GTSAM and Ceres' pose-graph reader take it; g2o's own optimiser measures rotations by the
    vector part of the quaternion, half the angle, and so takes them for four times less certain.
    """
    lines = [
        f"{_VERTEX} {node.number} {_numbers(_seven(T))}"
        for node, T in zip(graph.nodes, graph.poses, strict=True)
    ]
    if graph.nodes:
        lines.append(f"{_FIX} {graph.nodes[0].number}")
    for edge in graph.edges:
        values = np.concatenate([_seven(edge.T_first_second), edge.information[_UPPER]])
        lines.append(f"{_EDGE} {edge.first} {edge.second} {_numbers(values)}")
    with atomic_path(path) as temporary:
        temporary.write_text("".join(line + "\n" for line in lines), encoding="ascii")


def read_g2o(path: Path | str) -> PoseGraph:
    """Read a three-dimensional graph; edges that do not join neighbouring nodes are taken for loops.

    FIX lines are passed over. Raises DataError naming file and line for any other line and for numbers that are no
    pose or no information matrix.
    """
    path = Path(path)
    try:
        text = read_bytes(path).decode("ascii")
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: expected a g2o file in ASCII, got other bytes") from error
    nodes: dict[int, Node] = {}
    parsed: list[tuple[int, int, FloatArray, FloatArray]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        tag, *words = line.split() or ["#"]
        where = f"{path}, line {number}"
        if tag == _VERTEX:
            (name,), values = _parsed(words, 1, 7, where)
            if name in nodes:
                raise DataError(f"{where}: expected each vertex once, got {name} again")
            nodes[name] = _built(where, Node, name, _matrix(values, where))
        elif tag == _EDGE:
            (first, second), values = _parsed(words, 2, 28, where)
            information = np.zeros((6, 6))
            information[_UPPER] = values[7:]
            information.T[_UPPER] = values[7:]
            edge = _built(where, Edge, first, second, _matrix(values[:7], where), information)
            parsed.append((first, second, edge.T_first_second, edge.information))
        elif tag != _FIX and not tag.startswith("#"):
            raise DataError(f"{where}: expected {_VERTEX}, {_EDGE} or {_FIX}, got {tag!r}")
    rank = {name: position for position, name in enumerate(sorted(nodes))}
    try:
        edges = tuple(Edge(a, b, T, m, loop=rank[b] - rank[a] != 1) for a, b, T, m in parsed)
    except KeyError as error:
        raise DataError(
            f"{path}: expected a vertex for every end of an edge, got none for {error}"
        ) from error
    return PoseGraph(tuple(nodes[name] for name in sorted(nodes)), edges)


def _seven(T: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_quat()])


def _numbers(values: FloatArray) -> str:
    return " ".join(map(repr, values.tolist()))


def _parsed(words: list[str], n_names: int, n_values: int, where: str) -> tuple[list[int], FloatArray]:
    if len(words) != n_names + n_values:
        raise DataError(f"{where}: expected {n_names + n_values} numbers, got {len(words)}")
    try:
        names = [int(word) for word in words[:n_names]]
        values = np.array([float(word) for word in words[n_names:]])
    except ValueError as error:
        raise DataError(f"{where}: expected numbers, got {' '.join(words)[:60]!r}") from error
    return names, values


def _matrix(seven: FloatArray, where: str) -> FloatArray:
    from scipy.spatial.transform import Rotation

    norm = float(np.linalg.norm(seven[3:]))
    if not abs(norm - 1) < _QUATERNION_TOLERANCE:
        raise DataError(f"{where}: expected a unit quaternion qx qy qz qw, got one of length {norm:g}")
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(seven[3:]).as_matrix()
    T[:3, 3] = seven[:3]
    return T


def _built(where: str, kind: Any, *arguments: Any) -> Any:
    try:
        return kind(*arguments)
    except DataError as error:
        raise DataError(f"{where}: {error}") from error
