"""Data sets by name, and which one a path looks like."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from depthprint.datasets import generic as _generic
from depthprint.datasets import kitti_odometry as _kitti
from depthprint.datasets import seven_scenes as _seven_scenes
from depthprint.datasets import uw_rgbd_object as _uw
from depthprint.datasets.base import ObjectSet, RangeSequence
from depthprint.datasets.carmen_laser import carmen_laser
from depthprint.errors import DataError, SettingsError

__all__ = ["OBJECT_SETS", "SEQUENCES", "guess_dataset", "open_objects", "open_sequence"]


def _simulated_street(poses_file: Path | str | None = None, **options: Any) -> RangeSequence:
    from depthprint.datasets.simulated_street import simulated_street

    _check_options("simulated_street", simulated_street, options)
    return simulated_street(poses_file=None if poses_file is None else Path(poses_file), **options)


SEQUENCES: dict[str, Callable[..., RangeSequence]] = {
    "carmen_laser": carmen_laser,
    "generic": _generic.generic,
    "kitti_odometry": _kitti.kitti_odometry,
    "seven_scenes": _seven_scenes.seven_scenes,
    "simulated_street": _simulated_street,
}

OBJECT_SETS: dict[str, Callable[..., ObjectSet]] = {
    "cad51": _uw.cad51,
    "uw_rgbd_object": _uw.uw_rgbd_object,
}

LOG_SUFFIXES = (".log", ".log.gz", ".clf", ".clf.gz")
LOOKED_FOR = (
    "a CARMEN log (*.log, *.log.gz), frame-XXXXXX.depth.png or seq-XX folders of them (seven_scenes), "
    "'sequences' or a sequence folder (kitti_odometry), or depth images (*.png, *.pgm, *.npy, *.npz) or "
    "point clouds (*.bin, *.pcd, *.ply) of one kind (generic)"
)


def open_sequence(
    path: Path | str | None = None, dataset: str | None = None, sequence: str | None = None, **options: Any
) -> RangeSequence:
    """Open frames in time order, guessing the data set from the path where it is not named.

    dataset: a name in ``SEQUENCES``, '-' and '_' alike. sequence: for sets of several sequences. options: go
        to the loader. 'simulated_street' needs no path; one that is given is its pose file.
    Raises SettingsError for a name or option that does not exist, DataError for a path that looks like no
    data set.
    """
    if dataset is None:
        if path is None:
            raise SettingsError("open_sequence: expected a path or the name of a data set, got neither")
        dataset = guess_dataset(path)
    name = _known(dataset, SEQUENCES)
    loader = SEQUENCES[name]
    if path is None and name != "simulated_street":
        raise SettingsError(f"{name}: expected a path, got none")
    if sequence is not None:
        if "sequence" not in inspect.signature(loader).parameters:
            raise SettingsError(f"{name}: has no sequences to choose from, got sequence {sequence!r}")
        options["sequence"] = sequence
    _check_options(name, loader, options)
    return loader(**options) if path is None else loader(path, **options)


def open_objects(root: Path | str, dataset: str | None = None, **options: Any) -> ObjectSet:
    """Open views of objects; without a name, a folder 'cad51' is cad51 and any other the UW layout.

    Raises SettingsError for a name or option that does not exist, DataError for another layout.
    """
    if dataset is None:
        dataset = "cad51" if Path(root).resolve().name == "cad51" else "uw_rgbd_object"
    name = _known(dataset, OBJECT_SETS)
    _check_options(name, OBJECT_SETS[name], options)
    return OBJECT_SETS[name](root, **options)


def guess_dataset(path: Path | str) -> str:
    """Name of the data set that a path looks like; the first of these rules that holds.

    A file *.log, *.log.gz or *.clf: carmen_laser. A folder with frame-XXXXXX.depth.png files, or with seq-XX
    folders of them: seven_scenes. A folder with ``sequences`` or ``dataset/sequences`` below it, or with
    ``velodyne``, ``image_0`` and ``image_1``, or ``image_2`` and ``image_3``: kitti_odometry. A folder with
    depth images or point
    clouds: generic. Raises DataError that lists what was looked for; one for objects says where they go.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(f"{path}: expected data, got no such file or folder")
    if path.is_file():
        if path.name.lower().endswith(LOG_SUFFIXES):
            return "carmen_laser"
        raise DataError(f"{path}: looks like no known data set; looked for {LOOKED_FOR}")
    if _seven_scenes.has_frames(path) or _seven_scenes.sequence_folders(path):
        return "seven_scenes"
    if _kitti.is_sequence_folder(path) or _kitti.sequences_folder(path) is not None:
        return "kitti_odometry"
    if _generic.has_frames(path):
        return "generic"
    if _uw.has_views(path):
        raise DataError(f"{path}: holds views of objects, not a sequence; expected {LOOKED_FOR}")
    raise DataError(f"{path}: looks like no known data set; looked for {LOOKED_FOR}")


def _known(dataset: str, registry: dict[str, Any]) -> str:
    name = dataset.replace("-", "_")
    if name not in registry:
        raise SettingsError(f"dataset: expected one of {', '.join(sorted(registry))}, got {dataset!r}")
    return name


def _check_options(name: str, loader: Callable[..., Any], options: dict[str, Any]) -> None:
    parameters = inspect.signature(loader).parameters
    if any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        return
    unknown = sorted(set(options) - set(parameters))
    if unknown:
        known = [p for p in parameters if p not in ("path", "root", "folder")]
        raise SettingsError(f"{name}: expected options among {', '.join(known)}, got {unknown[0]!r}")
