"""The pose graph and the trajectories that a run leaves behind, for the optimiser of whoever plugs it in."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import MissingExtraError
from depthprint.io.poses import write_kitti_poses, write_tum_poses
from depthprint.pose_graph import Edge, EdgeNoise, graph_from_odometry, write_g2o
from depthprint.verification import GeometricVerifier
from depthprint.verification.view_cache import ViewCache

if TYPE_CHECKING:
    from depthprint.datasets.base import RangeSequence
    from depthprint.encoder import Encoder
    from depthprint.evaluation.loop_record import LoopRecord
    from depthprint.run_folder import RunFolder
    from depthprint.runs.stages import Stages

__all__ = ["LOOP_NOISE", "step_noises", "write_loop_graph"]

FloatArray = npt.NDArray[np.float64]

# What aligned depth of a street or a room is good for; an optimiser should use a robust loss besides.
LOOP_NOISE = EdgeNoise(translation_m=0.2, rotation_rad=math.radians(1.0))
# Odometry of unknown make: one percent of the way and half a degree a metre, never better than a centimetre.
_STEP_SHARE, _STEP_RAD_PER_M, _LEAST = 0.01, math.radians(0.5), EdgeNoise(0.01, math.radians(0.05))


def write_loop_graph(
    run: RunFolder,
    sequence: RangeSequence,
    encoder: Encoder,
    loops: Sequence[LoopRecord],
    poses: FloatArray,
    stamps_s: Sequence[float],
    stages: Stages,
) -> dict[str, Any]:
    """Write graph.g2o, trajectory_kitti.txt and trajectory_tum.txt; say in numbers what the graph holds.

    poses: (n, 4, 4) T_world_sensor of each frame, by odometry or otherwise known; the motions between are the graph's
    odometry edges. Loops become edges where the geometric check can be made (small_gicp is installed) and accepts them.
    """
    graph = graph_from_odometry(poses, step_noises(poses))
    edges = _loop_edges(sequence, encoder, loops, stages)
    write_g2o(run.file("graph.g2o"), graph.with_edges(edges or []))
    write_kitti_poses(run.file("trajectory_kitti.txt"), poses)
    write_tum_poses(run.file("trajectory_tum.txt"), stamps_s, poses)
    return {
        "nodes": len(graph.nodes),
        "odometry_edges": len(graph.edges),
        "loop_edges": None if edges is None else len(edges),
        "loops_refused": None if edges is None else len(loops) - len(edges),
    }


def step_noises(poses: FloatArray) -> list[EdgeNoise]:
    """Noise of each step of an odometry of unknown make, from its length."""
    metres = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).tolist()
    return [
        EdgeNoise(
            max(_LEAST.translation_m, _STEP_SHARE * step), max(_LEAST.rotation_rad, _STEP_RAD_PER_M * step)
        )
        for step in metres
    ]


def _loop_edges(
    sequence: RangeSequence, encoder: Encoder, loops: Sequence[LoopRecord], stages: Stages
) -> list[Edge] | None:
    verifier, views = GeometricVerifier(), ViewCache()
    progress = stages("verify loops")
    edges = []
    for done, loop in enumerate(loops):
        query, match = views(sequence[loop.query]), views(sequence[loop.match])
        try:
            found = verifier.verify(query, match, yaw_rad=encoder.yaw_of_shift(loop.shift))
        except MissingExtraError as error:
            logging.getLogger("depthprint").warning("graph.g2o holds no loops: %s", error)
            return None
        if found.accepted:
            edges.append(Edge(loop.match, loop.query, found.T_match_query, LOOP_NOISE.information, loop=True))
        progress(done + 1, len(loops))
    return edges
