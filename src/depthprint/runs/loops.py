"""Find the loops of one recording: the package's main job, with everything it leaves behind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import RangeSequence
from depthprint.errors import DataError, SettingsError
from depthprint.runs.found_loops import FoundLoops, SampledDistances
from depthprint.runs.models import require_model
from depthprint.runs.source import DataSource, spread
from depthprint.runs.stages import RunSummary, Stages, silent
from depthprint.runs.threshold import background_threshold

if TYPE_CHECKING:
    from depthprint.encoder import Encoder
    from depthprint.evaluation.ground_truth import TruthMatrix
    from depthprint.evaluation.loop_record import LoopRecord
    from depthprint.evaluation.loops import LoopEvaluation
    from depthprint.range_image import RangeImage

__all__ = ["run_loops", "sample_distances", "truth_with_gap"]

METHOD = "emd"
# Frames whose distances are all taken, for the threshold and the figure: every pair costs EMDs.
_SAMPLED_FRAMES = 200


def run_loops(
    source: DataSource,
    out: Path,
    *,
    preset: str | None = None,
    model: Path | None = None,
    threshold: float | None = None,
    gap: int | None = None,
    odometry: Path | None = None,
    seed: int = 0,
    stages: Stages = silent,
) -> RunSummary:
    """Compare each frame with those more than ``gap`` frames older, and write loops, scores and figures to ``out``.

    A match is a loop when its distance is at most ``threshold``; None sets it by ``background_threshold``. With poses
    the loops are scored by the query-wise protocol; without, results.json holds none. A pose graph and trajectories are
    made of ``odometry``, a pose file, or else of the poses, for whoever optimises them. Raises DataError when the
    recording is too short for the gap, and as its parts do; the folder appears only when all ended well.
    """
    from depthprint.evaluation.loops import evaluate_loops
    from depthprint.place_methods import make_place_recognizer
    from depthprint.run_folder import RunFolder
    from depthprint.runs.loop_figures import draw_loop_figures
    from depthprint.runs.loop_graph import write_loop_graph

    if threshold is not None and not math.isfinite(threshold):
        raise SettingsError(f"threshold: expected a finite distance, got {threshold}")
    sequence = truth_with_gap(source.open(stages("make the world")), gap)
    path = sequence.poses if odometry is None else _odometry(odometry, len(sequence))
    stamps = _Stamps(sequence)
    sequence = replace(sequence, read=stamps.read)
    encoder = require_model(model, preset, sequence.preset)
    settings = {
        "data": source.settings(),
        "preset": encoder.settings.name,
        "model": None if model is None else str(model),
        "fingerprint": encoder.fingerprint,
        "gap": sequence.truth.gap,
        "threshold": threshold,
        "odometry": None if odometry is None else str(odometry),
        "encoder": encoder.settings.model_dump(mode="json"),
    }
    with RunFolder(out, settings, seed=seed) as run:
        truth = _truth(sequence, stages)
        recognizer = make_place_recognizer(METHOD, encoder.settings.name, encoder)
        evaluation = evaluate_loops(
            sequence, {METHOD: recognizer}, truth, seed=seed, progress=stages("find loops")
        )
        sample = sample_distances(sequence, encoder, stages)
        found = _decide(evaluation.methods[0].records, threshold, sample, sequence.truth.gap)
        results = _report(sequence, evaluation, found, settings)
        if path is not None:
            results["graph"] = write_loop_graph(
                run, sequence, encoder, found.loops, path, stamps.all_s, stages
            )
        run.write_json("results.json", results)
        run.write_csv("loops.csv", *_rows(found, scored=sequence.poses is not None))
        drawn = draw_loop_figures(run, sequence, encoder, evaluation, found, sample)
    return RunSummary(
        folder=out,
        figures=tuple(out / "figures" / path.name for path in drawn),
        sentence=_sentence(sequence, found),
        results=results,
        table=_table(results) if sequence.poses is not None else None,
    )


def truth_with_gap(sequence: RangeSequence, gap: int | None) -> RangeSequence:
    """Set the gap where one is given; raise DataError when it leaves no frame anything to be compared with."""
    if gap is not None:
        if gap < 0:
            raise SettingsError(f"gap: expected a number >= 0, got {gap}")
        sequence = replace(sequence, truth=replace(sequence.truth, gap=gap))
    if len(sequence) < sequence.truth.gap + 2:
        frames = "a single frame" if len(sequence) == 1 else f"{len(sequence)} frames"
        raise DataError(
            f"{sequence.name}: {frames} and a gap of {sequence.truth.gap} leave nothing to compare; "
            f"expected at least {sequence.truth.gap + 2} frames, or a smaller --gap"
        )
    return sequence


def _odometry(path: Path, frames: int) -> npt.NDArray[np.float64]:
    from depthprint.io.poses import read_poses

    poses = read_poses(path)
    if len(poses) != frames:
        raise DataError(f"{path}: expected {frames} poses, one a frame, got {len(poses)}")
    return poses


class _Stamps:
    """Reads a sequence's frames and keeps their stamps: the frames' own, or else their numbers."""

    def __init__(self, sequence: RangeSequence) -> None:
        self._read = sequence.read
        self.all_s = [float(index) for index in range(len(sequence))]

    def read(self, index: int) -> RangeImage:
        image = self._read(index)
        if image.stamp_s is not None:
            self.all_s[index] = image.stamp_s
        return image


def _truth(sequence: RangeSequence, stages: Stages) -> TruthMatrix:
    from depthprint.evaluation.ground_truth import TruthMatrix, loop_ground_truth

    if sequence.poses is not None:
        return loop_ground_truth(sequence, sequence.truth, stages("ground truth"))
    unknown = np.zeros((len(sequence), len(sequence)), dtype=np.int8)
    return TruthMatrix(unknown, sequence.truth.gap, "none: poses are not known")


def sample_distances(sequence: RangeSequence, encoder: Encoder, stages: Stages) -> SampledDistances:
    """All distances between at most 200 frames, evenly spread."""
    from depthprint.objects.distances import complexity_distances

    frames = spread(len(sequence), _SAMPLED_FRAMES)
    progress = stages("compare a sample")
    encodings = []
    for done, frame in enumerate(frames):
        encodings.append(encoder.describe(sequence[frame]))
        progress(done + 1, len(frames))
    return SampledDistances(np.array(frames, dtype=np.int64), complexity_distances(encoder, encodings))


def _decide(
    records: Sequence[LoopRecord], threshold: float | None, sample: SampledDistances, gap: int
) -> FoundLoops:
    if threshold is not None:
        return FoundLoops(tuple(records), threshold, "given")
    far = sample.frames[:, None] - sample.frames[None, :] > gap
    learned = None
    if far.sum() > 1:
        candidates = float(np.mean([record.query - gap for record in records]))
        learned = background_threshold(sample.distances[far], candidates)
    return FoundLoops(tuple(records), learned, "spread of the distances of frames far apart in time")


def _report(
    sequence: RangeSequence, evaluation: LoopEvaluation, found: FoundLoops, settings: dict[str, Any]
) -> dict[str, Any]:
    from depthprint.evaluation.report import loop_report

    report = loop_report(evaluation, settings)
    loops = found.loops
    report["loops"] = {
        "accepted": len(loops),
        "threshold": found.threshold,
        "threshold_from": found.threshold_from,
    }
    if sequence.poses is None:
        figures = report["methods"][METHOD]
        report["methods"] = {METHOD: {key: figures[key] for key in figures if key.startswith("ms_")}}
    else:
        report["loops"] |= {
            "true": sum(r.outcome == 1 for r in loops),
            "false": sum(r.outcome == -1 for r in loops),
            "ignored": sum(r.outcome == 0 for r in loops),
        }
    return report


def _rows(found: FoundLoops, *, scored: bool) -> tuple[list[str], list[list[Any]]]:
    names = {1: "positive", 0: "ignore", -1: "negative"}
    header = ["query", "match", "distance", "shift", "accepted"]
    rows = []
    for record in found.records:
        made = asdict(record)
        cells = [made[name] for name in header[:-1]]
        if record.match < 0:
            cells[1] = None
        cells.append(int(found.accepted(record)))
        if scored:
            cells += [names[record.outcome] if record.match >= 0 else None, int(record.has_positive)]
        rows.append(cells)
    return header + (["outcome", "has_positive"] if scored else []), rows


def _table(results: dict[str, Any]) -> Any:
    from depthprint.evaluation.report import results_table

    return results_table(results)


def _sentence(sequence: RangeSequence, found: FoundLoops) -> str:
    kind = "simulated" if sequence.simulated else "recorded"
    n, loops = len(sequence), found.loops
    if found.threshold is None or not loops:
        return f"No frame of the {n} {kind} ones is near enough to an earlier place to be called a loop."
    first = f"{len(loops)} of {n} {kind} frames return to a place seen before (distance at most {found.threshold:.3g})"
    if sequence.poses is None:
        return first + "; without poses nobody can say how many of them are right."
    true, false = (sum(r.outcome == value for r in loops) for value in (1, -1))
    to_find = sum(r.has_positive for r in found.records)
    return first + f": by the poses {true} are right, {false} wrong, and there were {to_find} to find."
