"""One tree of errors: each says what was expected, what came, and where."""

from __future__ import annotations

__all__ = [
    "ConvergenceError",
    "DataError",
    "DepthprintError",
    "FingerprintError",
    "MissingExtraError",
    "ModelError",
    "SettingsError",
]


class DepthprintError(Exception):
    """Root of every error that depthprint raises on purpose."""


class DataError(DepthprintError, ValueError):
    """Input data (a file, a frame, an array) is not what it must be; the message names it."""


class SettingsError(DepthprintError, ValueError):
    """A setting has a value that it cannot have, or two settings exclude each other."""


class ModelError(DepthprintError):
    """A model file is damaged, of another version, or does not fit its use."""


class FingerprintError(ModelError, ValueError):
    """Signatures of different dictionaries or settings were mixed."""


class ConvergenceError(DepthprintError, ArithmeticError):
    """A solver stopped before the optimum: no value is better than a wrong one."""


class MissingExtraError(DepthprintError, ImportError):
    """An optional part is not installed; the message holds the pip line that installs it."""
