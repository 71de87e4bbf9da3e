"""Pose graphs optimised by GTSAM, with losses that wrong loops cannot bend."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from depthprint.errors import ConvergenceError, MissingExtraError, SettingsError
from depthprint.pose_graph.graph import Edge, PoseGraph

__all__ = ["Loss", "OptimizedGraph", "optimize_pose_graph"]

Loss = Literal["gnc", "cauchy", "huber", "squared"]

# Where the first node is held; far below any odometry's noise.
_HELD_SIGMA = 1e-6
# Published tuning constants, which keep 95 % efficiency where the noise is normal.
_CONSTANTS = {"huber": 1.345, "cauchy": 2.385}


@dataclass(frozen=True)
class OptimizedGraph:
    """The graph with its corrected poses.

    loop_weights: (m,) float64 in 0..1, how far each loop was believed, in the order of ``graph.loops``: under 'gnc'
    near 0 or 1; under the other losses the weight of its residual at the end. initial_error, final_error: weighted
    squares, halved and summed, of all edges as the loss counts them ('gnc': of odometry and believed loops).
    """

    graph: PoseGraph
    loop_weights: npt.NDArray[np.float64]
    initial_error: float
    final_error: float


def optimize_pose_graph(graph: PoseGraph, *, loss: Loss = "gnc", max_iterations: int = 100) -> OptimizedGraph:
    """Move the poses to where odometry and loops agree best; the first node stays.

    loss: of the loops; odometry always counts by squares. 'gnc' is graduated non-convexity over truncated squares
    (Yang, Antonante, Tzoumas, Carlone, RA-L 2020), which takes or drops each loop; 'cauchy' and 'huber' weigh them
    down; 'squared' trusts all. Raises MissingExtraError without GTSAM, SettingsError for another loss or a graph
    without edges, ConvergenceError when the optimiser ends with poses that are not finite.
    """
    if loss not in get_args(Loss):
        raise SettingsError(f"loss: expected one of {', '.join(get_args(Loss))}, got {loss!r}")
    if max_iterations < 1:
        raise SettingsError(f"max_iterations: expected at least 1, got {max_iterations}")
    if len(graph.nodes) < 2 or not graph.edges:
        raise SettingsError("pose graph: expected at least two nodes and an edge to optimise")
    gtsam = _gtsam()
    held = graph.nodes[0]
    factors = gtsam.NonlinearFactorGraph()
    values = gtsam.Values()
    for node in graph.nodes:
        values.insert(node.number, gtsam.Pose3(node.T_world_sensor))
    hold = gtsam.noiseModel.Isotropic.Sigma(6, _HELD_SIGMA)
    factors.add(gtsam.PriorFactorPose3(held.number, gtsam.Pose3(held.T_world_sensor), hold))
    for edge in graph.edges:
        factors.add(_factor(gtsam, edge, loss))
    initial = float(factors.error(values))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(max_iterations)
    loops = [position for position, edge in enumerate(graph.edges, start=1) if edge.loop]
    if loss == "gnc" and loops:
        values, weights = _graduated(gtsam, factors, values, parameters, loops)
        weighted = [1.0] * factors.size()
        for position, weight in zip(loops, weights.tolist(), strict=True):
            weighted[position] = weight
        final = sum(w * factors.at(i).error(values) for i, w in enumerate(weighted))
    else:
        values = gtsam.LevenbergMarquardtOptimizer(factors, values, parameters).optimize()
        weights = np.array([_weight(gtsam, factors.at(i), values) for i in loops], dtype=np.float64)
        final = float(factors.error(values))
    poses = np.stack([values.atPose3(node.number).matrix() for node in graph.nodes])
    if not (np.isfinite(poses).all() and np.isfinite(final)):
        raise ConvergenceError(f"pose graph: the optimiser ended with poses that are not finite ({loss})")
    weights.setflags(write=False)
    return OptimizedGraph(graph.with_poses(poses), weights, initial, float(final))


def _gtsam() -> Any:
    try:
        import gtsam
    except ImportError as error:
        raise MissingExtraError(
            "optimising a pose graph needs GTSAM: pip install 'depthprint[slam]'"
        ) from error
    return gtsam


def _factor(gtsam: Any, edge: Edge, loss: Loss) -> Any:
    # GTSAM's tangent space has rotation before translation.
    order = np.array([3, 4, 5, 0, 1, 2])
    noise = gtsam.noiseModel.Gaussian.Information(edge.information[np.ix_(order, order)])
    if edge.loop and loss in _CONSTANTS:
        kinds = gtsam.noiseModel.mEstimator
        kernel = (kinds.Huber if loss == "huber" else kinds.Cauchy).Create(_CONSTANTS[loss])
        noise = gtsam.noiseModel.Robust.Create(kernel, noise)
    return gtsam.BetweenFactorPose3(edge.first, edge.second, gtsam.Pose3(edge.T_first_second), noise)


def _graduated(
    gtsam: Any, factors: Any, values: Any, parameters: Any, loops: list[int]
) -> tuple[Any, npt.NDArray[np.float64]]:
    settings = gtsam.GncLMParams(parameters)
    settings.setLossType(gtsam.GncLossType.TLS)
    settings.setKnownInliers([i for i in range(factors.size()) if i not in set(loops)])
    optimizer = gtsam.GncLMOptimizer(factors, values, settings)
    values = optimizer.optimize()
    return values, np.asarray(optimizer.getWeights(), dtype=np.float64)[loops]


def _weight(gtsam: Any, factor: Any, values: Any) -> float:
    noise = factor.noiseModel()
    if not isinstance(noise, gtsam.noiseModel.Robust):
        return 1.0
    return float(noise.robust().weight(noise.noise().mahalanobisDistance(factor.unwhitenedError(values))))
