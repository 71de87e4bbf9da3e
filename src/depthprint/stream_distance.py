"""StreamDistance: how items are compared by one of their streams."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from depthprint._pairs import Form, Masses, check_form, check_masses
from depthprint.errors import SettingsError
from depthprint.signature import GroundDistance

__all__ = ["StreamDistance"]


@dataclass(frozen=True)
class StreamDistance:
    """Distance of one stream of an item: ``weight`` times the normalised distance, or the EMD (form None)."""

    ground: GroundDistance = field(default_factory=GroundDistance)
    masses: Masses = "null"
    form: Form | None = "information"
    weight: float = 1.0

    def __post_init__(self) -> None:
        check_masses(self.masses)
        check_form(self.form)
        if not (np.isfinite(self.weight) and self.weight > 0):
            raise SettingsError(f"StreamDistance: expected a finite weight > 0, got {self.weight}")
