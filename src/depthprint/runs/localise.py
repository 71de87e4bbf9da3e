"""Find the frames of one recording in the map of another."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import SettingsError
from depthprint.loop_closure import LoopClosureDetector, LoopResult
from depthprint.place import Place
from depthprint.place_database import PlaceDatabase
from depthprint.runs.source import DataSource, spread
from depthprint.runs.stages import RunSummary, Stages, silent
from depthprint.runs.threshold import background_threshold

if TYPE_CHECKING:
    from depthprint.datasets.base import RangeSequence
    from depthprint.recognizer import PlaceRecognizer
    from depthprint.run_folder import RunFolder

__all__ = ["run_map_localise"]

_SAMPLED_PLACES = 200
# Places closer in the map than this many numbers may show the same surroundings.
_FAR_APART = 50
_NOWHERE = -1.0
# The detector's distances of matches that geometry accepts are under 1.
_ALL_ACCEPTED = 1.0


@dataclass(frozen=True)
class _Located:
    """A frame, the nearest place of the map, and T_world_sensor (4, 4) of the frame where the frame is localised."""

    frame: int
    stamp_s: float
    result: LoopResult
    T_world_sensor: npt.NDArray[np.float64] | None


def run_map_localise(
    source: DataSource,
    map_path: Path,
    out: Path,
    *,
    threshold: float | None = None,
    stages: Stages = silent,
) -> RunSummary:
    """Find each frame of a recording among the places of a map, described by the map's own model.

    Without a ``threshold`` the detector says which frames are localised: those whose match geometry accepts. For a map
    without views, or of hand-held views where small_gicp is not installed, and with a ``threshold``, the distance
    alone decides: the nearest place must be at most ``threshold`` away, by default as far as ``background_threshold``
    allows from distances between places far apart in the map. results.json names the method.
    Writes localised.csv, results.json and, where places have poses, trajectory_tum.txt: for each localised frame the
    pose of its place, moved by T_match_query where that was measured.
    Raises SettingsError for a map without places and a threshold that is not finite, and as its parts do.
    """
    from depthprint.run_folder import RunFolder

    if threshold is not None and not math.isfinite(threshold):
        raise SettingsError(f"threshold: expected a finite distance, got {threshold}")
    with PlaceDatabase.open(map_path, read_only=True) as database:
        if not len(database):
            raise SettingsError(f"{map_path}: expected a map with places, it has none")
        sequence = source.open(stages("make the world"))
        settings = {
            "data": source.settings(),
            "map": str(map_path),
            "preset": database.preset,
            "fingerprint": database.fingerprint,
            "threshold": threshold,
        }
        with RunFolder(out, settings) as run:
            checked = threshold is None and _can_be_checked(database)
            method = "detector" if checked else "emd"
            limit, origin = threshold, "given"
            if checked:
                limit, origin = _ALL_ACCEPTED, "geometry"
            elif limit is None:
                limit = _threshold_of_map(database, stages)
                origin = "spread of the distances of places far apart in the map"
            recognizer = _recognizer(database, checked)
            detector = LoopClosureDetector(
                recognizer,
                exclusion_gap=0,
                threshold=_NOWHERE if limit is None else limit,
                database=database,
            )
            located = _locate(detector, sequence, stages)
            results = {
                "data": sequence.name,
                "simulated": sequence.simulated,
                "map": {
                    "path": str(map_path),
                    "places": len(database),
                    "runs": [made.name for made in database.runs],
                },
                "frames": len(located),
                "localised": sum(found.result.accepted for found in located),
                "with_pose": sum(found.T_world_sensor is not None for found in located),
                "threshold": limit,
                "threshold_from": origin,
                "method": method,
            }
            run.write_json("results.json", results)
            run.write_csv("localised.csv", *_rows(located, database))
            _write_trajectory(run, located)
    return RunSummary(folder=out, figures=(), sentence=_sentence(results), results=results)


def _recognizer(database: PlaceDatabase, checked: bool) -> PlaceRecognizer:
    from depthprint.cascade.assembly import make_cascade
    from depthprint.cascade.settings import CascadeSettings
    from depthprint.complexity_recognizer import ComplexityRecognizer

    encoder = database.load_encoder()
    if not checked:
        return ComplexityRecognizer(encoder)
    # Frames are looked up, not added: there is no motion to follow.
    settings = CascadeSettings(track=False)
    kept = database[0].arrays
    if "thumbnail" not in kept:
        settings = replace(settings, thumbnail_weight=0.0)
    return make_cascade(encoder, replace(settings, columns="columns" in kept))


def _can_be_checked(database: PlaceDatabase) -> bool:
    """Whether the map keeps the views that geometry compares, and what compares them is there."""
    from importlib.util import find_spec

    from depthprint.errors import DataError
    from depthprint.verification.view_arrays import unpack_view

    try:
        view = unpack_view(database[0].arrays)
    except DataError:
        return False
    return not view.settings.whole_clouds or find_spec("small_gicp") is not None


def _threshold_of_map(database: PlaceDatabase, stages: Stages) -> float | None:
    from depthprint.encoding_arrays import unpack_encoding
    from depthprint.objects.distances import complexity_distances

    chosen = np.array(spread(len(database), _SAMPLED_PLACES), dtype=np.int64)
    far = chosen[:, None] - chosen[None, :] > min(_FAR_APART, len(database) // 4)
    if far.sum() < 2:
        return None
    progress = stages("compare places of the map")
    encodings = []
    for number in chosen.tolist():
        encodings.append(unpack_encoding(database[number].arrays, database.fingerprint))
        progress(len(encodings), len(chosen))
    distances = complexity_distances(database.load_encoder(), encodings)
    return background_threshold(distances[far], float(len(database)))


def _locate(detector: LoopClosureDetector, sequence: RangeSequence, stages: Stages) -> list[_Located]:
    progress = stages("localise")
    located = []
    for index in range(len(sequence)):
        image = sequence[index]
        result = detector.query(image)
        place = detector.places[result.match] if result.accepted and result.match is not None else None
        stamp_s = float(index) if image.stamp_s is None else image.stamp_s
        located.append(_Located(index, stamp_s, result, None if place is None else _pose(place, result)))
        progress(index + 1, len(sequence))
    return located


def _pose(place: Place, result: LoopResult) -> npt.NDArray[np.float64] | None:
    if place.T_world_sensor is None or result.T_match_query is None:
        return place.T_world_sensor
    return np.asarray(place.T_world_sensor @ result.T_match_query)


def _rows(located: list[_Located], database: PlaceDatabase) -> tuple[list[str], list[list[Any]]]:
    header = ["frame", "place", "distance", "localised", "run", "number_in_run", "source"]
    rows: list[list[Any]] = []
    for found in located:
        row: list[Any] = [found.frame, found.result.match, found.result.distance, int(found.result.accepted)]
        if found.result.match is None:
            rows.append([*row, None, None, None])
            continue
        stored = database[found.result.match]
        rows.append([*row, stored.run, stored.number_in_run, stored.place.source])
    return header, rows


def _write_trajectory(run: RunFolder, located: list[_Located]) -> None:
    from depthprint.io.poses import write_tum_poses

    posed = [(found.stamp_s, found.T_world_sensor) for found in located if found.T_world_sensor is not None]
    if posed:
        stamps_s, poses = zip(*posed, strict=True)
        write_tum_poses(run.file("trajectory_tum.txt"), stamps_s, np.stack(poses))


def _sentence(results: dict[str, Any]) -> str:
    kind = "simulated" if results["simulated"] else "recorded"
    places = results["map"]["places"]
    if results["threshold"] is None:
        return (
            f"None of {results['frames']} {kind} frames is localised: the {places} places of the map are too few, or "
            "too alike, to set a threshold from."
        )
    return (
        f"{results['localised']} of {results['frames']} {kind} frames are localised among {places} places "
        + (
            "(detector: accepted by geometry)."
            if results["method"] == "detector"
            else f"(emd: distance at most {results['threshold']:.3g})."
        )
    )
