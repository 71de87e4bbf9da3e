"""Pose graphs: where the sensor was, and what odometry and loops measured between."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.io.poses import check_poses
from depthprint.rigid_motion import inverse_pose

__all__ = ["Edge", "EdgeNoise", "MeasuredLoop", "Node", "PoseGraph", "graph_from_odometry"]

FloatArray = npt.NDArray[np.float64]


class MeasuredLoop(Protocol):
    """What of a detector's result, a ``LoopResult`` say, makes an edge."""

    @property
    def query(self) -> int:
        """Number of the frame as a place."""

    @property
    def match(self) -> int | None:
        """The place that it was found at."""

    @property
    def accepted(self) -> bool:
        """Whether a loop was closed."""

    @property
    def T_match_query(self) -> FloatArray | None:
        """(4, 4) pose of the query's sensor in the frame of the match's, where it was measured."""


@dataclass(frozen=True)
class EdgeNoise:
    """Standard deviations of a relative pose: of each axis of its translation, metres, and of its rotation, radians."""

    translation_m: float
    rotation_rad: float

    def __post_init__(self) -> None:
        for name, value in (("translation_m", self.translation_m), ("rotation_rad", self.rotation_rad)):
            if not (np.isfinite(value) and value > 0):
                raise SettingsError(f"EdgeNoise: expected {name} > 0, got {value}")

    @property
    def information(self) -> FloatArray:
        """(6, 6) inverse covariance of translation x y z, then rotation x y z."""
        sigmas = np.repeat([self.translation_m, self.rotation_rad], 3)
        return np.diag(1 / sigmas**2)


@dataclass(frozen=True)
class Node:
    """A frame and its pose T_world_sensor (4, 4) float64, read-only."""

    number: int
    T_world_sensor: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_world_sensor", _pose(self.T_world_sensor, f"node {self.number}"))


@dataclass(frozen=True)
class Edge:
    """A measured pose of the frame ``second`` in the frame of ``first``: T_first_second (4, 4) float64.

    information: (6, 6) symmetric positive definite, of translation x y z (metres) and then rotation x y z (radians).
    loop: whether it closes a loop; the others are odometry. Arrays are read-only copies.
    """

    first: int
    second: int
    T_first_second: FloatArray
    information: FloatArray
    loop: bool = False

    def __post_init__(self) -> None:
        name = f"edge {self.first}-{self.second}"
        information = np.array(self.information, dtype=np.float64)
        if information.shape != (6, 6) or not np.isfinite(information).all():
            raise DataError(f"{name}: expected a finite information matrix (6, 6), got {information.shape}")
        if not np.array_equal(information, information.T) or np.linalg.eigvalsh(information)[0] <= 0:
            raise DataError(f"{name}: expected a symmetric, positive definite information matrix")
        information.setflags(write=False)
        object.__setattr__(self, "T_first_second", _pose(self.T_first_second, name))
        object.__setattr__(self, "information", information)


@dataclass(frozen=True)
class PoseGraph:
    """Nodes in the order of their numbers, and edges between them. Raises DataError where they do not fit."""

    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]

    def __post_init__(self) -> None:
        numbers = [node.number for node in self.nodes]
        for before, number in pairwise(numbers):
            if not before < number:
                raise DataError(f"pose graph: expected nodes by rising number, got {number} after {before}")
        known = set(numbers)
        for edge in self.edges:
            missing = {edge.first, edge.second} - known
            if missing or edge.first == edge.second:
                raise DataError(
                    f"pose graph: expected edges between two of its nodes, got {edge.first}-{edge.second}"
                )

    @property
    def poses(self) -> FloatArray:
        """(n, 4, 4) T_world_sensor of the nodes."""
        return np.stack([node.T_world_sensor for node in self.nodes]) if self.nodes else np.empty((0, 4, 4))

    @property
    def loops(self) -> tuple[Edge, ...]:
        """The edges that close loops."""
        return tuple(edge for edge in self.edges if edge.loop)

    def with_poses(self, poses: npt.ArrayLike) -> PoseGraph:
        """The graph with other poses (n, 4, 4), in the order of the nodes."""
        checked = check_poses(poses, "pose graph")
        if len(checked) != len(self.nodes):
            raise DataError(f"pose graph: expected {len(self.nodes)} poses, got {len(checked)}")
        nodes = (replace(node, T_world_sensor=pose) for node, pose in zip(self.nodes, checked, strict=True))
        return PoseGraph(tuple(nodes), self.edges)

    def with_edges(self, edges: Iterable[Edge]) -> PoseGraph:
        """The graph with these edges added."""
        return PoseGraph(self.nodes, (*self.edges, *edges))

    def with_loops(self, results: Iterable[MeasuredLoop], noise: EdgeNoise) -> PoseGraph:
        """The graph with an edge for each accepted loop whose T_match_query was measured; others are left out.

        A node is numbered as its place. Raises DataError for a loop between places that are no nodes.
        """
        found = []
        for result in results:
            if result.accepted and result.match is not None and result.T_match_query is not None:
                found.append(
                    Edge(result.match, result.query, result.T_match_query, noise.information, loop=True)
                )
        return self.with_edges(found)


def graph_from_odometry(
    poses: npt.ArrayLike, noise: EdgeNoise | Sequence[EdgeNoise], numbers: Sequence[int] | None = None
) -> PoseGraph:
    """A chain: odometry poses (n, 4, 4) T_world_sensor as nodes, the motion between neighbours as edges.

    noise: of one step, or one each of the n - 1 steps. numbers: of the nodes, 0, 1, ... when None.
    Raises DataError for what are no poses, SettingsError for another number of noises or of numbers.
    """
    checked = check_poses(poses, "odometry")
    if numbers is None:
        numbers = range(len(checked))
    steps = [noise] * max(0, len(checked) - 1) if isinstance(noise, EdgeNoise) else list(noise)
    if len(steps) != max(0, len(checked) - 1) or len(numbers) != len(checked):
        raise SettingsError(
            f"odometry: expected {len(checked)} numbers and one noise, or {len(checked) - 1}, "
            f"got {len(numbers)} and {len(steps)}"
        )
    nodes = tuple(Node(int(n), T) for n, T in zip(numbers, checked, strict=True))
    edges = tuple(
        Edge(
            a.number,
            b.number,
            inverse_pose(a.T_world_sensor) @ b.T_world_sensor,
            step.information,
        )
        for a, b, step in zip(nodes, nodes[1:], steps, strict=False)
    )
    return PoseGraph(nodes, edges)


def _pose(T: npt.ArrayLike, name: str) -> FloatArray:
    checked: FloatArray = check_poses(np.array(T, dtype=np.float64)[None], name)[0]
    checked.setflags(write=False)
    return checked
