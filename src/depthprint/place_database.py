"""Places on disk: a map in one SQLite file, which holds every place that was committed, whatever came after."""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, FingerprintError, SettingsError
from depthprint.place import Place, checked_pose
from depthprint.place_schema import (
    Row,
    array_row,
    connect,
    create_file,
    facts_row,
    place_checksum,
    read_array,
    read_facts,
    sqlite_errors,
)

if TYPE_CHECKING:
    import sqlite3

    from depthprint.encoder import Encoder

__all__ = ["PlaceDatabase", "Run", "StoredPlace"]

Arrays = Mapping[str, npt.NDArray[Any]]

_PLACE_COLUMNS = "number, run, number_in_run, stamp_s, T_world_sensor, source"


@dataclass(frozen=True)
class Run:
    """One recording in a map: its number there, its name, whether its depth is simulated, and 'up' in its world."""

    number: int
    name: str
    simulated: bool = False
    world_up: tuple[float, float, float] = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class StoredPlace:
    """A place with its arrays (read-only, by name) and its provenance: the run, and its number in that run."""

    place: Place
    arrays: Arrays
    run: int
    number_in_run: int


class PlaceDatabase:
    """A map that is made by ``create`` or opened by ``open``; a context manager that closes it.

    Places are numbered 0, 1, ... in the order of ``add``, each with named arrays: what its recogniser made of the frame
    and, where the map keeps points, ``points_xyz`` (n, 3) float32 in the sensor frame, metres. Each place is committed
    on its own, or with others inside ``transaction``. The model that described the places is part of the map. One
    process writes at a time; one object serves one thread at a time.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        self._run: int | None = None
        self._count_in_run = 0
        self._in_transaction = False
        with self._whole():
            text, checksum = connection.execute("SELECT facts, checksum FROM map").fetchone()
            facts = read_facts(path, text, checksum)
            self.fingerprint = str(facts["fingerprint"])
            self.preset = str(facts["preset"])
            self.voxel_m: float | None = facts["voxel_m"]
            self._count = int(connection.execute("SELECT count(*) FROM places").fetchone()[0])

    @classmethod
    def create(cls, path: Path | str, encoder: Encoder, *, voxel_m: float | None = None) -> PlaceDatabase:
        """Make an empty map for the places that ``encoder`` describes.

        voxel_m: side of the voxels to which the detector thins the points that it stores; None stores none.
        Raises SettingsError when the file exists already or ``voxel_m`` is not positive, ModelError for an encoder that
        is not fitted, DataError when the file cannot be written.
        """
        path = Path(path)
        if path.exists():
            raise SettingsError(f"{path}: expected the name of a new map, this file exists")
        if voxel_m is not None and not (np.isfinite(voxel_m) and voxel_m > 0):
            raise SettingsError(f"voxel_m: expected a length > 0 or None, got {voxel_m}")
        with tempfile.TemporaryDirectory() as folder:
            model = encoder.save(Path(folder) / "model.npz").read_bytes()
        facts = {"fingerprint": encoder.fingerprint, "preset": encoder.settings.name, "voxel_m": voxel_m}
        create_file(path, facts, model)
        return cls.open(path)

    @classmethod
    def open(
        cls, path: Path | str, *, fingerprint: str | None = None, read_only: bool = False
    ) -> PlaceDatabase:
        """Open a map, as it was after its last commit.

        fingerprint: of the model that the map must have been made with, or None for any. Raises DataError for a
        missing, damaged or other file, one of another version or in use; FingerprintError for one of another model.
        """
        path = Path(path)
        database = cls._opened(path, read_only)
        if fingerprint is not None and database.fingerprint != fingerprint:
            found = database.fingerprint
            database.close()
            raise FingerprintError(f"{path}: expected a map made by model {fingerprint}, got one of {found}")
        return database

    @classmethod
    def _opened(cls, path: Path, read_only: bool) -> PlaceDatabase:
        connection = connect(path, read_only=read_only)
        try:
            return cls(path, connection)
        except BaseException:
            connection.close()
            raise

    def __enter__(self) -> PlaceDatabase:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; what was not committed is not kept."""
        self._connection.close()

    def __len__(self) -> int:
        return self._count

    @property
    def runs(self) -> tuple[Run, ...]:
        """The recordings that the places are of."""
        with self._whole():
            rows = self._connection.execute("SELECT number, facts, checksum FROM runs ORDER BY number")
            return tuple(_run(number, read_facts(self.path, text, check)) for number, text, check in rows)

    def begin_run(
        self, name: str, *, simulated: bool = False, world_up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    ) -> Run:
        """Begin a recording: the places added from here on are of it."""
        with self.transaction(), sqlite_errors(self.path):
            number = self._connection.execute("SELECT count(*) FROM runs").fetchone()[0]
            facts = facts_row({"name": name, "simulated": simulated, "world_up": list(world_up)})
            self._connection.execute("INSERT INTO runs VALUES (?, ?, ?)", (number, *facts))
            self._run, self._count_in_run = int(number), 0
        return Run(int(number), name, simulated, world_up)

    def add(self, place: Place, arrays: Arrays) -> None:
        """Store a place, whose number must be the next one, and commit it.

        It belongs to the run begun last; without one, to a run without a name. Raises DataError for another number, a
        pose that is not (4, 4) and finite, a stamp that is not finite, arrays that are not numbers, and when the file
        cannot be written.
        """
        pose = None if place.T_world_sensor is None else checked_pose(place.T_world_sensor, place.number)
        if place.number != self._count:
            raise DataError(f"{self.path}: expected place {self._count} to be added next, got {place.number}")
        if place.stamp_s is not None and not np.isfinite(place.stamp_s):
            raise DataError(f"frame {place.number}: expected a finite stamp or None, got {place.stamp_s}")
        rows = [array_row(name, array) for name, array in arrays.items()]
        with self.transaction(), sqlite_errors(self.path):
            if self._run is None:
                self.begin_run("")
            row = (
                place.number,
                self._run,
                self._count_in_run,
                None if place.stamp_s is None else float(place.stamp_s) + 0.0,  # SQLite keeps no minus zero
                None if pose is None else pose.astype("<f8").tobytes(),
                place.source,
            )
            self._connection.execute(
                "INSERT INTO places VALUES (?, ?, ?, ?, ?, ?, ?)", (*row, place_checksum(row, rows))
            )
            self._connection.executemany(
                "INSERT INTO arrays VALUES (?, ?, ?, ?, ?, ?)",
                [(place.number, position, *made) for position, made in enumerate(rows)],
            )
            self._count += 1
            self._count_in_run += 1

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit what is added within all at once, or nothing of it when an error passes. May be nested."""
        if self._in_transaction:
            yield
            return
        before = self._count, self._run, self._count_in_run
        with sqlite_errors(self.path):
            self._connection.execute("BEGIN IMMEDIATE")
        self._in_transaction = True
        try:
            yield
            with sqlite_errors(self.path):
                self._connection.execute("COMMIT")
        except BaseException:
            self._count, self._run, self._count_in_run = before
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            raise
        finally:
            self._in_transaction = False

    def __getitem__(self, number: int) -> StoredPlace:
        """A place by its number; IndexError beyond the last, DataError when it was damaged."""
        if not 0 <= number < self._count:
            raise IndexError(number)
        return next(self._read(number, number + 1))

    def __iter__(self) -> Iterator[StoredPlace]:
        """Places by number, each read when it is asked for; DataError naming the first that was damaged."""
        return self._read(0, self._count)

    def load_encoder(self) -> Encoder:
        """The model that described the places; DataError when it was damaged."""
        from depthprint.encoder import Encoder

        with self._whole():
            row = self._connection.execute("SELECT model, model_checksum FROM map").fetchone()
            model, checksum = row
            if zlib.crc32(model) != checksum:
                raise DataError(f"{self.path}: expected a whole place database, got an altered model")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "model.npz"
            path.write_bytes(model)
            return Encoder.load(path)

    @contextmanager
    def _whole(self) -> Iterator[None]:
        try:
            with sqlite_errors(self.path):
                yield
        except (ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
            if isinstance(error, DataError):
                raise
            raise DataError(
                f"{self.path}: expected a whole place database, got a damaged one ({error})"
            ) from error

    def _read(self, first: int, end: int) -> Iterator[StoredPlace]:
        for number in range(first, end):
            with self._whole():
                stored = self._stored(number)
            yield stored

    def _stored(self, number: int) -> StoredPlace:
        found = self._connection.execute(
            f"SELECT {_PLACE_COLUMNS}, checksum FROM places WHERE number = ?", (number,)
        ).fetchone()
        rows: list[Row] = self._connection.execute(
            "SELECT name, dtype, shape, data FROM arrays WHERE place = ? ORDER BY position", (number,)
        ).fetchall()
        if found is None or place_checksum(found[:-1], rows) != found[-1]:
            raise DataError(f"{self.path}, place {number}: expected a whole place, got a damaged one")
        _, run, number_in_run, stamp_s, pose, source, _ = found
        T_world_sensor = None
        if pose is not None:
            T_world_sensor = checked_pose(np.frombuffer(pose, dtype="<f8").reshape(4, 4), number)
        place = Place(number, stamp_s, T_world_sensor, source)
        return StoredPlace(place, {row[0]: read_array(row) for row in rows}, run, number_in_run)


def _run(number: int, facts: dict[str, Any]) -> Run:
    x, y, z = map(float, facts["world_up"])
    return Run(number, str(facts["name"]), bool(facts["simulated"]), (x, y, z))
