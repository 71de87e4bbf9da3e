"""Proposals spread out in time: neighbouring frames see one place, and are one proposal."""

from __future__ import annotations

from collections.abc import Sequence

from depthprint.recognizer import PlaceMatch

__all__ = ["spread_in_time"]


def spread_in_time(matches: Sequence[PlaceMatch], k: int, spread: int) -> list[PlaceMatch]:
    """The first k of some matches, best first, no two of which are less than ``spread`` places apart."""
    chosen: list[PlaceMatch] = []
    for match in matches:
        if len(chosen) == k:
            break
        if all(abs(match.place - other.place) >= spread for other in chosen):
            chosen.append(match)
    return chosen
