"""What one method answered to one query."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["LoopRecord"]


@dataclass(frozen=True)
class LoopRecord:
    """One query of one method; ``match`` is -1 and ``distance`` NaN where no match was made.

    translation_error_m, rotation_error_deg: of a match's T_match_query that geometry accepted, where poses are known.
    """

    query: int
    match: int
    distance: float
    shift: float | None
    outcome: int
    has_positive: bool
    translation_error_m: float | None = None
    rotation_error_deg: float | None = None
