"""Two maps of one model made into one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import FingerprintError, SettingsError
from depthprint.io.atomic import atomic_path
from depthprint.io.poses import check_poses
from depthprint.place import Place
from depthprint.place_database import PlaceDatabase

__all__ = ["merge_maps"]


def merge_maps(
    first: Path | str,
    second: Path | str,
    out: Path | str,
    *,
    T_first_second: npt.ArrayLike | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write the places of ``first``, then those of ``second``, to the new map ``out``; return how many there are.

    Places of ``second`` are numbered on from those of ``first``; runs and the places' numbers in them are kept.
    T_first_second: (4, 4), takes the world of ``second`` to that of ``first``; None leaves all poses as they are, each
    in the world of its own run. Points that ``second`` keeps are kept, whether ``first`` does or not. Raises
    FingerprintError for maps of two models, SettingsError when ``out`` exists, DataError as ``PlaceDatabase.open``.
    """
    out = Path(out)
    if out.exists():
        raise SettingsError(f"{out}: expected the name of a new map, this file exists")
    move = (
        None if T_first_second is None else check_poses(np.asarray(T_first_second)[None], "T_first_second")[0]
    )
    with PlaceDatabase.open(first, read_only=True) as a, PlaceDatabase.open(second, read_only=True) as b:
        if a.fingerprint != b.fingerprint:
            raise FingerprintError(
                f"{second}: expected a map made by model {a.fingerprint}, as {first}, got one of {b.fingerprint}"
            )
        total = len(a) + len(b)
        with (
            atomic_path(out) as temporary,
            PlaceDatabase.create(temporary, a.load_encoder(), voxel_m=a.voxel_m) as merged,
            merged.transaction(),
        ):
            for source, T_world in ((a, None), (b, move)):
                _append(merged, source, T_world, progress, total)
    return total


def _append(
    merged: PlaceDatabase,
    source: PlaceDatabase,
    T_world: npt.NDArray[np.float64] | None,
    progress: Callable[[int, int], None] | None,
    total: int,
) -> None:
    runs = source.runs
    run = -1
    for stored in source:
        if stored.run != run:
            run = stored.run
            kept = runs[run]
            merged.begin_run(kept.name, simulated=kept.simulated, world_up=kept.world_up)
        merged.add(_moved(replace(stored.place, number=len(merged)), T_world), stored.arrays)
        if progress is not None:
            progress(len(merged), total)


def _moved(place: Place, T_world: npt.NDArray[np.float64] | None) -> Place:
    if T_world is None or place.T_world_sensor is None:
        return place
    return replace(place, T_world_sensor=T_world @ place.T_world_sensor)
