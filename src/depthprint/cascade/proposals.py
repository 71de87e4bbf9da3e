"""Proposals spread out in time: neighbouring frames see one place, and are one proposal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.recognizer import PlaceMatch

__all__ = ["spread_in_time", "taken_in_turn"]


def spread_in_time(matches: Sequence[PlaceMatch], k: int, spread: int) -> list[PlaceMatch]:
    """The first k of some matches, best first, no two of which are less than ``spread`` places apart."""
    chosen: list[PlaceMatch] = []
    for match in matches:
        if len(chosen) == k:
            break
        if all(abs(match.place - other.place) >= spread for other in chosen):
            chosen.append(match)
    return chosen


def taken_in_turn(
    rankings: Sequence[npt.NDArray[np.int64]], places: int, k: int, spread: int
) -> npt.NDArray[np.int64]:
    """Up to k of some places (0, 1, ...), the best that is left of each ranking in turn, ``spread`` or more apart.

    So one kind of evidence need not outweigh another for its best places to be looked at.
    """
    taken = np.zeros(places, dtype=bool)
    chosen: list[int] = []
    left = [iter(ranking.tolist()) for ranking in rankings]
    while left and len(chosen) < k:
        for ranking in tuple(left):
            place = next((place for place in ranking if not taken[place]), None)
            if place is None:
                left.remove(ranking)
                continue
            chosen.append(place)
            taken[max(0, place - spread + 1) : place + spread] = True
            if len(chosen) == k:
                break
    return np.array(chosen, dtype=np.int64)
