"""Where frames may have been, and what such hypotheses say of another frame by the motion between."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from depthprint.rigid_motion import inverse_pose, rotation_angle
from depthprint.verification.depth_odometry import DepthOdometry
from depthprint.verification.settings import VerificationSettings

__all__ = ["Hypotheses", "Hypothesis", "OtherFrames", "poses_agree", "said_by", "seconded_from_behind"]

FloatArray = npt.NDArray[np.float64]

# Share of its evidence that a hypothesis keeps over one witness distance.
_KEPT = 0.7


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A place where a frame may have been.

    T_match_query: (4, 4) pose of the frame in the place. strength: evidence in [0, 1) with that of earlier frames,
    support: that of the earlier frames alone. accepted: whether the frame was called a match of the place.
    alone: evidence of the frame without that of earlier ones. told: strength, averaged with the evidence along the way.
    """

    place: int
    T_match_query: FloatArray
    strength: float
    support: float
    accepted: bool
    alone: float = 0.0
    told: float = 0.0


Hypotheses = Mapping[int, Sequence[Hypothesis]]


@dataclass(frozen=True)
class OtherFrames:
    """What other frames say of one being at a pose in a place.

    support: evidence in [0, 1) of the hypotheses that lead there. frames: those of the way about it that were asked,
    whether or not they lead there, and evidence: sum of what those that do said alone. heading: share in (0, 1] of its
    own evidence that the frame keeps, by the heading carried along.
    """

    support: float = 0.0
    evidence: float = 0.0
    frames: int = 0
    heading: float = 1.0

    def along_way(self, alone: float) -> float:
        """Mean evidence of the way's frames and of the one asked about, which says ``alone``."""
        return (alone + self.evidence) / (1 + self.frames)

    def joined(self, other: OtherFrames) -> OtherFrames:
        """Of frames that are others on both sides."""
        support = 1.0 - (1.0 - self.support) * (1.0 - other.support)
        heading = min(self.heading, other.heading)
        return OtherFrames(support, self.evidence + other.evidence, self.frames + other.frames, heading)


def said_by(
    hypotheses: Hypotheses,
    place: int,
    T_place_query: FloatArray,
    pose_in: Callable[[int], FloatArray | None],
    odometry: DepthOdometry,
    settings: VerificationSettings,
) -> OtherFrames:
    """What the hypotheses of other frames, the nearest first, say of a query's being at a pose (4, 4) in a place.

    pose_in: T_number_query of the query in another frame, None beyond a break of odometry, where the asking ends.
    A hypothesis counts when it, moved by odometry, leads there within tolerance. One from further off than the
    witness distance supports by its strength, as an independent view; a nearer one saw nearly the same, and
    counts less the nearer it is, but hands on its own support. All fade with the distance driven.
    """
    support, evidence, frames = 0.0, 0.0, 0
    for number, of_frame in hypotheses.items():
        if not (of_frame or settings.way_m):
            continue
        T_number_query = pose_in(number)
        if T_number_query is None:
            break
        driven_m = float(np.linalg.norm(T_number_query[:3, 3]))
        driven = driven_m / settings.witness_m
        said = 0.0
        for hypothesis in of_frame:
            T_place_match = odometry.relative_pose(place, hypothesis.place)
            if T_place_match is None:
                continue
            T_expected = T_place_match @ hypothesis.T_match_query @ T_number_query
            if poses_agree(T_expected, T_place_query, max(1.0, driven), settings):
                witness = min(1.0, driven) * _KEPT ** max(1.0, driven) * hypothesis.strength
                support = max(support, witness, _KEPT**driven * hypothesis.support)
                said = max(said, hypothesis.alone)
        if driven_m < settings.way_m:
            evidence, frames = evidence + said, frames + 1
    return OtherFrames(support, evidence, frames)


def seconded_from_behind(
    hypotheses: Hypotheses, odometry: DepthOdometry, settings: VerificationSettings
) -> dict[int, tuple[Hypothesis, ...]]:
    """Hypotheses of consecutive frames, first to last, with the evidence of later frames in place of earlier ones'."""
    seconded: dict[int, tuple[Hypothesis, ...]] = {}
    for number in sorted(hypotheses, reverse=True):
        pose_in = partial(odometry.relative_pose, second=number)
        told = []
        for one in hypotheses[number]:
            later = said_by(seconded, one.place, one.T_match_query, pose_in, odometry, settings)
            strength = 1.0 - (1.0 - one.alone) * (1.0 - later.support)
            told.append(replace(one, strength=strength, support=later.support))
        seconded = {number: tuple(told), **seconded}
    return seconded


def poses_agree(first: FloatArray, second: FloatArray, slack: float, settings: VerificationSettings) -> bool:
    """Whether two poses (4, 4) are one, within ``slack`` times what the sensor's settings allow."""
    apart = inverse_pose(first) @ second
    metres = float(np.linalg.norm(apart[:3, 3]))
    return (
        metres <= slack * settings.agreeing_m
        and float(rotation_angle(apart)) <= slack * settings.agreeing_rad
    )
