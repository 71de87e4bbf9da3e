"""Which stages the cascade detector runs, and how far each looks."""

from __future__ import annotations

from dataclasses import dataclass

from depthprint.errors import SettingsError

__all__ = ["CascadeSettings"]

# Chosen on simulated rooms. On planar scans thumbnails lose; on the street they were tried beside the cosine alone.
_THUMBNAILS_IN_PERSPECTIVE = 0.3


@dataclass(frozen=True)
class CascadeSettings:
    """Stages of the detector; each can be turned off, to measure what it buys.

    vectors: a cosine of the pooled codes with shift search proposes ``proposed`` places; off: the exact search does.
    relaxed: relaxed bounds of the EMD choose the ``ranked`` most promising of them; off: the cosine does.
    exact: the exact NCD ranks them, with ``vector_weight`` of the cosine in the sum; off: the cosine alone does.
    thumbnail_weight: weight of the centred thumbnails' distance in both sums, 0 for none; None: 0.3 where views in
        perspective are coded, 0 for bird's-eye ones.
    columns: where geometry follows, half of the ranked places are those that the uncoded columns of a bird's-eye map
        propose; None: for hand-held views and planar scans. Never on a full circle, where every shift is to be tried.
    correlated: the best so many places proposed of planar scans are ordered by how well the scans correlate before
        any is checked; 0: as proposed.
    verify: the best ``verified`` places (None: as many as suit the sensor), at least ``spread`` frames apart, are
        checked by geometry.
    turned: so many places of a forward view, seen under a heading that the distances do not reach, are checked where
        no other was accepted.
    climb: a checked place is exchanged for a neighbour of greater overlap.
    consistency: without ``track``, places next to the previous frames' matches are checked too, and need less overlap.
    track: the motion between frames is followed by depth: places that it says are in view are checked first, and
        matches that earlier frames lead to expect need less agreement and count for more.
    heading: with ``track``, the heading is carried along too, and matches against it count for less.
    Raises SettingsError for values out of range, or without any distance.
    """

    vectors: bool = True
    relaxed: bool = True
    exact: bool = True
    columns: bool | None = None
    verify: bool = True
    climb: bool = True
    consistency: bool = True
    track: bool = True
    heading: bool = True
    proposed: int = 40
    ranked: int = 8
    correlated: int = 40
    vector_weight: float = 0.5
    thumbnail_weight: float | None = None
    verified: int | None = None
    turned: int = 2
    spread: int = 4

    def __post_init__(self) -> None:
        for name in ("proposed", "ranked", "verified", "spread"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise SettingsError(f"CascadeSettings: expected {name} >= 1, got {value}")
        for name in ("turned", "correlated"):
            if getattr(self, name) < 0:
                raise SettingsError(f"CascadeSettings: expected {name} >= 0, got {getattr(self, name)}")
        if not 0 <= self.vector_weight <= 1:
            raise SettingsError(
                f"CascadeSettings: expected vector_weight in [0, 1], got {self.vector_weight}"
            )
        if self.thumbnail_weight is not None and not 0 <= self.thumbnail_weight <= 1:
            raise SettingsError(
                f"CascadeSettings: expected thumbnail_weight in [0, 1] or None, got {self.thumbnail_weight}"
            )
        if not (self.vectors or self.exact):
            raise SettingsError("CascadeSettings: expected vectors or exact, got neither: nothing would rank")

    def weight_of_thumbnails(self, *, perspective: bool) -> float:
        """``thumbnail_weight``, or what suits views in perspective, or bird's-eye ones."""
        if self.thumbnail_weight is not None:
            return self.thumbnail_weight
        return _THUMBNAILS_IN_PERSPECTIVE if perspective else 0.0
