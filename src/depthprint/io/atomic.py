"""Files appear whole or not at all: written under a temporary name, then renamed."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from depthprint.errors import DataError

__all__ = ["atomic_path"]


@contextmanager
def atomic_path(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside ``path``, with its suffix; rename it on success, remove it on error.

    The temporary file does not exist yet when it is yielded. Missing parent folders are made. Raises
    DataError when the folder cannot be made or written to.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        folder = tempfile.mkdtemp(prefix=f".{target.stem}-", dir=target.parent)
    except OSError as error:
        raise DataError(f"{target}: expected a folder that can be written to, got {error}") from error
    temporary = Path(folder) / target.name
    try:
        yield temporary
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
        os.rmdir(folder)
