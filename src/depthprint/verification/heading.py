"""HeadingTrack: which way each frame looked, carried from frame to frame and held by matches."""

from __future__ import annotations

import math
from array import array

from depthprint.verification.turns import Turn

__all__ = ["HeadingTrack"]

# Deviation of what a right match says of a heading, apart from what turns have lost.
_MATCH_SD_RAD = math.radians(15.0)
# So far off no match is doubted: what looks alike in buildings is turned by a quarter or a half.
_FREE_RAD = math.radians(40.0)
# Share of its evidence that a match against all headings keeps.
_LEAST_SHARE = 0.2
# A match that would keep less does not hold the heading.
_HOLDING_SHARE = 0.7
_NO_TURN = Turn(0.0, 0.0)


class HeadingTrack:
    """Heading and its variance of frames, numbered as they are added.

    Turns from frame to frame add up, and so do their variances; a trusted match pulls the heading to its place's. The
    more was lost between two frames, the less a match of them is doubted; none is that is off by less than 40 degrees.
    """

    def __init__(self) -> None:
        self._headings_rad, self._variances = array("d"), array("d")

    def __len__(self) -> int:
        return len(self._headings_rad)

    def add(self, turn: Turn) -> None:
        """Append a frame that is turned so from the one before; the first is where all are turned from."""
        heading_rad, variance = (self._headings_rad[-1], self._variances[-1]) if len(self) else (0.0, 0.0)
        self._headings_rad.append(heading_rad + turn.left_rad)
        self._variances.append(variance + turn.variance)

    def hold(self, place: int, turn_rad: float) -> None:
        """Take in that the last frame was found turned so far to the left in an earlier one, if that is likely."""
        if self._share(-1, place, turn_rad, _NO_TURN, 0.0) < _HOLDING_SHARE:
            return
        away = math.remainder(self._headings_rad[place] + turn_rad - self._headings_rad[-1], math.tau)
        lost = abs(self._variances[-1] - self._variances[place])
        weight = lost / (lost + _MATCH_SD_RAD**2)
        self._headings_rad[-1] += weight * away
        self._variances[-1] += weight * (self._variances[place] - self._variances[-1])

    def share(self, place: int, turn_rad: float, next_turn: Turn, slack_rad: float = 0.0) -> float:
        """Share in (0, 1] of its evidence that a match of the next frame keeps.

        turn_rad: how far to the left of the place the match says that the frame looks. next_turn: from the last frame
        added to the next. slack_rad: that much off is not off.
        """
        return self._share(-1, place, turn_rad, next_turn, slack_rad) if len(self) else 1.0

    def share_of(self, number: int, place: int, turn_rad: float) -> float:
        """Share in (0, 1] of its evidence that a match of a frame already added keeps."""
        return self._share(number, place, turn_rad, _NO_TURN, 0.0)

    def _share(self, number: int, place: int, turn_rad: float, turn: Turn, slack_rad: float) -> float:
        apart = self._headings_rad[number] + turn.left_rad - self._headings_rad[place] - turn_rad
        off = max(0.0, abs(math.remainder(apart, math.tau)) - _FREE_RAD - slack_rad)
        lost = abs(self._variances[number] + turn.variance - self._variances[place])
        likely = math.exp(-0.5 * off**2 / (lost + _MATCH_SD_RAD**2))
        return _LEAST_SHARE + (1.0 - _LEAST_SHARE) * likely
