"""Reading whole files, with one error for every way in which that fails."""

from __future__ import annotations

from pathlib import Path

from depthprint.errors import DataError

__all__ = ["read_bytes"]


def read_bytes(path: Path) -> bytes:
    """Whole content of a file; DataError naming it when it cannot be read or is empty."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not content:
        raise DataError(f"{path}: expected a file with content, got an empty one")
    return content
