"""Model files are .npz archives without pickle: reading one whole, and writing it whole or not at all."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import ModelError
from depthprint.io.atomic import atomic_path

__all__ = ["DAMAGED", "read_archive", "read_header", "write_archive"]

# What zipfile, zlib, json and numpy raise on a damaged file; RuntimeError covers NotImplementedError.
DAMAGED = (
    OSError,
    EOFError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    IndexError,
    RuntimeError,
    SyntaxError,
    zipfile.BadZipFile,
    zlib.error,
)


def write_archive(
    path: Path | str, header: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]
) -> None:
    """Write a JSON ``header`` (with its 'format' and 'version') and arrays."""
    text = np.array(json.dumps(header, sort_keys=True))
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, header=text, **arrays)  # type: ignore[arg-type]


def read_archive(
    path: Path | str, what: str, file_format: str, version: int
) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Header and arrays of what ``write_archive`` wrote.

    Raises ModelError, naming the file, when it is missing, damaged, or of another format or version; ``what`` is the
    kind of file expected, in words.
    """
    try:
        # Read whole first: numpy leaves a damaged file open.
        with np.load(io.BytesIO(Path(path).read_bytes()), allow_pickle=False) as archive:
            header = json.loads(str(archive["header"]))
            found = (header["format"], header["version"])
            arrays = {name: archive[name] for name in archive.files if name != "header"}
    except DAMAGED as error:
        reason = str(error) or type(error).__name__
        raise ModelError(f"{path}: expected a {what} file, got {reason}") from error
    if found != (file_format, version):
        raise ModelError(
            f"{path}: expected {file_format!r} version {version}, got {found[0]!r} version {found[1]}"
        )
    return header, arrays


def read_header(path: Path | str) -> dict[str, Any]:
    """Header of any archive of ``write_archive``; ModelError, naming the file, when it is missing or another file."""
    try:
        with np.load(io.BytesIO(Path(path).read_bytes()), allow_pickle=False) as archive:
            header = json.loads(str(archive["header"]))
            return {"format": header["format"], "version": header["version"], **header}
    except DAMAGED as error:
        raise ModelError(
            f"{path}: expected a file of depthprint (.npz), found a damaged or other file ({error})"
        ) from error
