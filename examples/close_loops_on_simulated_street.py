"""Close the loops of a drive whose odometry drifts, and correct its path: all of it on a simulated street.

Simulated odometry leads through a simulated town (a spinning LiDAR, a fifth of the parked cars redrawn between visits).
The detector finds loops by depth alone and checks them by geometry, which gives their relative poses; GTSAM moves the
poses to where odometry and loops agree. The folder OUT gets graph.g2o, trajectories in the forms of KITTI and TUM,
errors.json, and the figure.

    pip install 'depthprint[slam]'
    python examples/close_loops_on_simulated_street.py OUT
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from depthprint import LoopClosureDetector, make_place_recognizer
from depthprint.datasets.simulated_street import simulated_street
from depthprint.evaluation.trajectory import absolute_trajectory_error, relative_pose_error
from depthprint.io.poses import write_kitti_poses, write_tum_poses
from depthprint.pose_graph import Edge, EdgeNoise, graph_from_odometry, optimize_pose_graph, write_g2o
from depthprint.simulation.odometry import OdometryNoise, simulate_odometry
from depthprint.visualization.trajectories import draw_trajectories

TOWN, LENGTH_M = 2015, 800.0
DRIFT = OdometryNoise(translation=0.02, heading_rad=0.004, scale=0.01, heading_bias_rad=0.0008)
STEP_NOISE = EdgeNoise(translation_m=0.03, rotation_rad=0.004)
LOOP_NOISE = EdgeNoise(translation_m=0.1, rotation_rad=0.01)


def main() -> None:
    """Drive, close loops, optimise, and say what it was good for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="folder to write")
    parser.add_argument("--seed", type=int, default=0, help="of the drift of odometry")
    parser.add_argument("--every", type=int, default=4, help="take every k-th frame, 0.8 m apart")
    parser.add_argument("--sensor", choices=("lidar", "stereo"), default="lidar", help="what is simulated")
    options = parser.parse_args()
    started = time.monotonic()

    street = simulated_street(seed=TOWN, length_m=LENGTH_M, every=options.every, sensor=options.sensor)
    odometry = simulate_odometry(street.poses, DRIFT, seed=options.seed)
    detector = LoopClosureDetector(
        make_place_recognizer("detector", street.preset), exclusion_gap=street.truth.gap, threshold=1.0
    )

    loops = []
    for frame, image in enumerate(street):
        result = detector.process(image, pose=odometry[frame])
        if result.accepted:
            T_match_query, information = result.T_match_query, LOOP_NOISE.information
            loops.append(Edge(result.match, frame, T_match_query, information, loop=True))

    graph = graph_from_odometry(odometry, STEP_NOISE).with_edges(loops)
    optimized = optimize_pose_graph(graph, loss="gnc")
    corrected = optimized.graph.poses

    options.out.mkdir(parents=True, exist_ok=True)
    write_g2o(options.out / "graph.g2o", graph)
    for name, poses in (("true", street.poses), ("odometry", odometry), ("corrected", corrected)):
        write_kitti_poses(options.out / f"{name}_kitti.txt", poses)
        write_tum_poses(options.out / f"{name}_tum.txt", np.arange(len(poses), dtype=float), poses)
    frames = np.array([(edge.first, edge.second) for edge in graph.loops]).reshape(-1, 2)
    apart_m = np.linalg.norm(np.diff(street.poses[frames, :3, 3], axis=1)[:, 0], axis=1)
    errors = {
        name: {
            "ate_rmse_m": absolute_trajectory_error(poses, street.poses),
            "relative_error_per_100_m": 100
            * relative_pose_error(poses, street.poses, 100.0).translation_share,
        }
        for name, poses in (("odometry", odometry), ("corrected", corrected))
    }
    errors["loops"] = {
        "closed": len(frames),
        "right": int((apart_m < 10).sum()),
        "believed": int((optimized.loop_weights > 0.5).sum()),
    }
    (options.out / "errors.json").write_text(json.dumps(errors, indent=2) + "\n")
    figure = draw_trajectories(
        *(poses[:, :2, 3] for poses in (street.poses, odometry, corrected)),
        frames,
        apart_m < 10,
        options.out / "trajectories.png",
        errors_m={name: errors[name]["ate_rmse_m"] for name in ("odometry", "corrected")},
        data=street.name,
        simulated=True,
    )
    print(json.dumps(errors, indent=2))
    print(f"figure: {figure}; {time.monotonic() - started:.0f} s")


if __name__ == "__main__":
    main()
