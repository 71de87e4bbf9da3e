"""Checks of the options that the simulated worlds share."""

from __future__ import annotations

import numpy as np

from depthprint.errors import SettingsError

__all__ = ["require_whole"]


def require_whole(name: str, value: object, least: int) -> None:
    """Raise SettingsError, naming the option, unless ``value`` is a whole number of at least ``least``."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise SettingsError(f"{name}: expected a whole number >= {least}, got {value!r}")
