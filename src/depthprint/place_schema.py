"""The SQLite file of a place database: its tables, how it is opened, and what is said when it is not whole."""

from __future__ import annotations

import json
import os
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.io.atomic import atomic_path

__all__ = [
    "SCHEMA_VERSION",
    "array_row",
    "connect",
    "create_file",
    "facts_row",
    "place_checksum",
    "read_array",
    "read_facts",
    "sqlite_errors",
]

SCHEMA_VERSION = 1
_APPLICATION_ID = 0x64707274  # 'dprt', in the file's header
_BUSY_S = 5.0

# A place's checksum covers its row and all its arrays: SQLite itself notices no flipped bit.
_TABLES = """
CREATE TABLE map (facts TEXT NOT NULL, checksum INTEGER NOT NULL, model BLOB NOT NULL, model_checksum INTEGER NOT NULL);
CREATE TABLE runs (number INTEGER PRIMARY KEY, facts TEXT NOT NULL, checksum INTEGER NOT NULL);
CREATE TABLE places (
    number INTEGER PRIMARY KEY,
    run INTEGER NOT NULL REFERENCES runs (number),
    number_in_run INTEGER NOT NULL,
    stamp_s REAL,
    T_world_sensor BLOB,
    source TEXT NOT NULL,
    checksum INTEGER NOT NULL
);
CREATE TABLE arrays (
    place INTEGER NOT NULL REFERENCES places (number),
    position INTEGER NOT NULL,
    name TEXT NOT NULL,
    dtype TEXT NOT NULL,
    shape TEXT NOT NULL,
    data BLOB NOT NULL,
    PRIMARY KEY (place, position)
);
"""

Row = tuple[Any, ...]


@contextmanager
def sqlite_errors(path: Path) -> Iterator[None]:
    """Say in this package's words, naming the file, what SQLite complains about."""
    try:
        yield
    except sqlite3.Error as error:
        reason = str(error)
        if "locked" in reason or "busy" in reason:
            raise DataError(
                f"{path}: expected a place database to itself, it is in use by another process"
            ) from error
        if "readonly" in reason or "unable to open" in reason or "full" in reason or "disk I/O" in reason:
            raise DataError(f"{path}: the place database cannot be used ({reason})") from error
        if isinstance(error, sqlite3.ProgrammingError):
            raise SettingsError(f"{path}: expected an open place database ({reason})") from error
        raise DataError(f"{path}: expected a whole place database, got a damaged file ({reason})") from error
    except UnicodeDecodeError as error:
        # What SQLite quotes of a damaged schema, in its complaint, need not be text.
        raise DataError(f"{path}: expected a whole place database, got a damaged file ({error})") from error


def create_file(path: Path, facts: Mapping[str, Any], model: bytes) -> None:
    """Write a database without places; the file appears whole or not at all."""
    with (
        atomic_path(path) as temporary,
        sqlite_errors(path),
        closing(sqlite3.connect(temporary, isolation_level=None)) as connection,
    ):
        connection.executescript(
            f"PRAGMA application_id = {_APPLICATION_ID}; PRAGMA user_version = {SCHEMA_VERSION}; {_TABLES}"
        )
        connection.execute(
            "INSERT INTO map VALUES (?, ?, ?, ?)", (*facts_row(facts), model, zlib.crc32(model))
        )


def connect(path: Path, *, read_only: bool) -> sqlite3.Connection:
    """Open an existing database, bring it back to its last commit after a crash, and check what kind it is.

    A rollback journal, synchronised with its folder: a committed place is in the one file, whatever comes after.
    Raises DataError when the file is missing, damaged, something else, or of another version.
    """
    if not path.is_file():
        raise DataError(f"{path}: no such place database")
    # Even a reader must be able to roll back what a crashed writer left, where it may write.
    mode = "rw" if os.access(path, os.W_OK) and os.access(path.parent, os.W_OK) else "ro"
    with sqlite_errors(path):
        connection = sqlite3.connect(
            f"{path.resolve().as_uri()}?mode={mode}",
            uri=True,
            timeout=_BUSY_S,
            isolation_level=None,
            check_same_thread=False,
        )
        try:
            found = [
                connection.execute(f"PRAGMA {name}").fetchone()[0]
                for name in ("application_id", "user_version")
            ]
            if found[0] != _APPLICATION_ID:
                raise DataError(f"{path}: expected a place database of depthprint, got another SQLite file")
            if found[1] != SCHEMA_VERSION:
                raise DataError(
                    f"{path}: expected a place database of version {SCHEMA_VERSION}, got version {found[1]}"
                )
            connection.execute("PRAGMA synchronous = EXTRA")
            connection.execute("PRAGMA foreign_keys = ON")
            if read_only:
                connection.execute("PRAGMA query_only = ON")
        except BaseException:
            connection.close()
            raise
    return connection


def facts_row(facts: Mapping[str, Any]) -> tuple[str, int]:
    """Facts as JSON, and its checksum."""
    text = json.dumps(dict(facts), sort_keys=True, allow_nan=False)
    return text, zlib.crc32(text.encode())


def read_facts(path: Path, text: str, checksum: int) -> dict[str, Any]:
    """What ``facts_row`` wrote; DataError when it was altered."""
    if zlib.crc32(text.encode()) != checksum:
        raise DataError(f"{path}: expected a whole place database, got altered facts {text[:60]!r}")
    facts = json.loads(text)
    return dict(facts)


def array_row(name: str, array: npt.NDArray[Any]) -> tuple[str, str, str, bytes]:
    """Name, dtype, shape and bytes of an array, little-endian and in C order."""
    if array.dtype.kind not in "biuf":
        raise DataError(f"array {name!r}: expected numbers, got dtype {array.dtype}")
    stored = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    return name, stored.dtype.str, json.dumps(array.shape), stored.tobytes()


def read_array(row: Row) -> npt.NDArray[Any]:
    """The array of ``array_row``, read-only."""
    _name, dtype, shape, data = row
    return np.frombuffer(data, dtype=np.dtype(dtype)).reshape(json.loads(shape))


def place_checksum(place_row: Row, array_rows: Iterable[Row]) -> int:
    """CRC-32 of everything that is stored of a place, as it is stored."""
    checksum = zlib.crc32(repr(tuple(place_row)).encode())
    for *head, data in array_rows:
        checksum = zlib.crc32(data, zlib.crc32(repr(head).encode(), checksum))
    return checksum
