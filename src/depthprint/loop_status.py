"""What a loop-closure detector answers: the status of a query, and the result that explains itself."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from depthprint.recognizer import PlaceMatch

__all__ = ["LoopResult", "LoopStatus"]


class LoopStatus(Enum):
    """What became of a query."""

    ACCEPTED = "accepted"
    TOO_FEW_PLACES = "too few places"
    CALIBRATING = "calibrating"
    NO_MATCH = "no match"
    ABOVE_THRESHOLD = "above threshold"
    FAILED_GEOMETRY = "failed geometry"
    AMBIGUOUS = "ambiguous"
    INCONSISTENT_IN_TIME = "inconsistent in time"


@dataclass(frozen=True)
class LoopResult:
    """Answer to one query, whatever it is.

    query: number that the frame has, or would have, as a place. status: what became of it.
    matches: proposed places, best first, accepted or not. threshold: the one in force, or None.
    candidates: how many places were old enough to be compared.
    probability: that the best proposed place is the frame's, and probability_new: that no place so far is; None
    where the detector does not estimate them, or not yet.
    """

    query: int
    status: LoopStatus
    matches: tuple[PlaceMatch, ...] = ()
    threshold: float | None = None
    candidates: int = 0
    exclusion_gap: int = 0
    min_places: int = 1
    probability: float | None = None
    probability_new: float | None = None

    @property
    def match(self) -> int | None:
        """Number of the best proposed place, accepted or not; None without a proposal."""
        return self.matches[0].place if self.matches else None

    @property
    def distance(self) -> float | None:
        """Distance of the best proposed place; None without a proposal."""
        return self.matches[0].distance if self.matches else None

    @property
    def score(self) -> float | None:
        """Negated distance of the best proposed place: larger is surer; None without a proposal."""
        return -self.matches[0].distance if self.matches else None

    @property
    def T_match_query(self) -> npt.NDArray[np.float64] | None:
        """(4, 4) pose of the query's sensor in the match's, where geometry accepted the match; else None."""
        verification = self.matches[0].verification if self.matches else None
        return None if verification is None or not verification.accepted else verification.T_match_query

    @property
    def inliers(self) -> int | None:
        """Points of the query that have a partner in the match; None where geometry was not checked."""
        verification = self.matches[0].verification if self.matches else None
        return None if verification is None else verification.inliers

    @property
    def overlap(self) -> float | None:
        """Share of the two views that agrees; None where geometry was not checked."""
        verification = self.matches[0].verification if self.matches else None
        return None if verification is None else verification.overlap

    @property
    def accepted(self) -> bool:
        """Whether a loop was closed."""
        return self.status is LoopStatus.ACCEPTED

    def explain(self) -> str:
        """Say in one sentence what was decided and why."""
        head = f"frame {self.query}: "
        if self.status is LoopStatus.TOO_FEW_PLACES:
            return head + (
                f"not compared, since {self.candidates} places are more than {self.exclusion_gap} frames old "
                f"and {self.min_places} are needed"
            )
        if self.status is LoopStatus.NO_MATCH:
            return head + f"the recogniser proposed none of the {self.candidates} places old enough"
        nearest = f"place {self.match} is the nearest of {self.candidates}, at distance {self.distance:.4g}"
        return head + nearest + self._decision()

    def _decision(self) -> str:
        if self.status is LoopStatus.CALIBRATING:
            return ", but too few pairs of places have been seen to set a threshold"
        if self.status is LoopStatus.FAILED_GEOMETRY:
            verification = self.matches[0].verification
            why = "" if verification is None else f": {verification.reason}"
            return ", but the geometric check refused it" + why
        if self.status is LoopStatus.ABOVE_THRESHOLD:
            return f", which is above the threshold {self.threshold:.4g}"
        if self.status is LoopStatus.AMBIGUOUS:
            other = self.matches[1]
            return f", but place {other.place}, elsewhere, is about as near at {other.distance:.4g}"
        if self.status is LoopStatus.INCONSISTENT_IN_TIME:
            return ", but no recent frame was matched nearby"
        closed = f", within the threshold {self.threshold:.4g}: loop closed"
        verification = self.matches[0].verification
        return closed if verification is None else f"{closed}; {verification.reason}"
