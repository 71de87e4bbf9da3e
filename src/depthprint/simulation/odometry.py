"""Odometry of a simulated vehicle: true motion, with noise that adds up to drift."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.errors import SettingsError
from depthprint.io.poses import check_poses
from depthprint.rigid_motion import inverse_pose
from depthprint.simulation.checks import require_whole

__all__ = ["OdometryNoise", "simulate_odometry"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class OdometryNoise:
    """Random errors per metre driven, and systematic ones that a seed draws once for a drive.

    translation: standard deviation of a metre's motion along each axis, metres; heading_rad, tilt_rad: of its turn
    about the world's vertical, and about the horizontal axes, radians. scale: standard deviation of the share by
    which all lengths are off; heading_bias_rad: of a turn of every metre, radians.
    """

    translation: float = 0.02
    heading_rad: float = 0.002
    tilt_rad: float = 0.0
    scale: float = 0.01
    heading_bias_rad: float = 0.0003

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0):
                raise SettingsError(f"OdometryNoise: expected {name} >= 0, got {value}")


def simulate_odometry(
    poses: npt.ArrayLike, noise: OdometryNoise | None = None, *, seed: int = 0
) -> FloatArray:
    """Odometry (n, 4, 4) T_world_sensor that starts at the first true pose; the world's z points up. Simulated data.

    Raises DataError for what are no poses, SettingsError for a seed that is no whole number >= 0.
    """
    from scipy.spatial.transform import Rotation

    noise = noise or OdometryNoise()
    require_whole("seed", seed, 0)
    true = check_poses(poses, "true trajectory")
    if not len(true):
        return true.copy()
    rng = np.random.default_rng([seed, 40961])
    motions = inverse_pose(true[:-1]) @ true[1:]
    metres = np.linalg.norm(motions[:, :3, 3], axis=1)
    scale = 1 + rng.normal(0, noise.scale)
    bias_rad = rng.normal(0, noise.heading_bias_rad)
    shifts_m = rng.normal(0, noise.translation, (len(motions), 3)) * np.sqrt(metres)[:, None]
    turns_rad = rng.normal(0, (noise.tilt_rad, noise.tilt_rad, noise.heading_rad), (len(motions), 3))
    turns_rad = turns_rad * np.sqrt(metres)[:, None] + np.outer(metres, (0.0, 0.0, bias_rad))
    # Turns are about the world's axes; a motion is in the frame of the sensor before it.
    turns_sensor = np.einsum("nji,nj->ni", true[:-1, :3, :3], turns_rad)
    motions[:, :3, :3] = Rotation.from_rotvec(turns_sensor).as_matrix() @ motions[:, :3, :3]
    motions[:, :3, 3] = scale * motions[:, :3, 3] + shifts_m
    drifted = np.empty_like(true)
    drifted[0] = true[0]
    for frame, motion in enumerate(motions):
        drifted[frame + 1] = drifted[frame] @ motion
    return drifted
