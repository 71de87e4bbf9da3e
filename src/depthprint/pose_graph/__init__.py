"""Pose graphs: built from odometry and loops, written and read as g2o, optimised by GTSAM."""

from __future__ import annotations

from depthprint.pose_graph.g2o import read_g2o, write_g2o
from depthprint.pose_graph.graph import Edge, EdgeNoise, Node, PoseGraph, graph_from_odometry
from depthprint.pose_graph.optimization import OptimizedGraph, optimize_pose_graph
from depthprint.rigid_motion import inverse_pose

__all__ = [
    "Edge",
    "EdgeNoise",
    "Node",
    "OptimizedGraph",
    "PoseGraph",
    "graph_from_odometry",
    "inverse_pose",
    "optimize_pose_graph",
    "read_g2o",
    "write_g2o",
]
