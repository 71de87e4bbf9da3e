"""Measure methods side by side by the protocols, and write what came out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from depthprint.datasets.base import name_and_kind
from depthprint.errors import DataError, SettingsError
from depthprint.range_image import RangeImage
from depthprint.runs.loops import truth_with_gap
from depthprint.runs.models import choose_model
from depthprint.runs.source import DataSource, spread
from depthprint.runs.stages import RunSummary, Stages, silent

__all__ = ["best_in_words", "run_evaluate_loops"]

_MOST_TRAINING_FRAMES = 200


def run_evaluate_loops(
    source: DataSource,
    out: Path,
    *,
    methods: Sequence[str],
    preset: str | None = None,
    model: Path | None = None,
    gap: int | None = None,
    delay: int = 0,
    imports: Mapping[str, Path] | None = None,
    vocabulary_from: Path | None = None,
    seed: int = 0,
    stages: Stages = silent,
) -> RunSummary:
    """Score methods on the loops of a recording with poses; one CSV of matches per method.

    delay: methods that can answer for a frame again after so many others get a second row, NAME-delay-N.
    imports: files of matches (query, match, score) that other programs made, by the name to show them under.
    vocabulary_from: another recording, for the methods that learn a vocabulary; the shipped one when None.
    Raises DataError when there are no poses, SettingsError for an unknown method, and as its parts do.
    """
    from depthprint.evaluation.ground_truth import loop_ground_truth
    from depthprint.evaluation.imported import read_match_file, score_matches
    from depthprint.evaluation.loops import evaluate_loops
    from depthprint.evaluation.report import loop_records, loop_report, metric_rows, results_table
    from depthprint.place_methods import make_place_recognizer
    from depthprint.run_folder import RunFolder
    from depthprint.runs.loop_figures import draw_evaluation_figures
    from depthprint.verification.view_cache import ViewCache

    sequence = truth_with_gap(source.open(stages("make the world")), gap)
    if sequence.poses is None:
        raise DataError(
            f"{sequence.name}: expected poses to score with, found none; 'depthprint loops' needs none"
        )
    name, encoder = choose_model(model, preset, sequence.preset)
    views = ViewCache()
    files = dict(imports or {})
    _check_names(methods, files)
    learn_from = None if vocabulary_from is None else _training_frames(vocabulary_from)
    recognizers = {
        method: make_place_recognizer(method, name, encoder, views, learn_from) for method in methods
    }
    settings = {
        "data": source.settings(),
        "methods": list(methods),
        "imports": {name: str(path) for name, path in files.items()},
        "preset": name,
        "model": None if model is None else str(model),
        "vocabulary_from": None if vocabulary_from is None else str(vocabulary_from),
        "gap": sequence.truth.gap,
        "delay": delay,
    }
    with RunFolder(out, settings, seed=seed) as run:
        truth = loop_ground_truth(sequence, sequence.truth, stages("ground truth"))
        # other programs' files are read first: a mistake in them should not cost a run
        matches = {name: read_match_file(path, truth) for name, path in files.items()}
        evaluation = evaluate_loops(
            sequence, recognizers, truth, seed=seed, delay=delay, progress=stages("describe and query")
        )
        imported = tuple(score_matches(name, found, truth, seed) for name, found in matches.items())
        evaluation = replace(evaluation, methods=evaluation.methods + imported)
        results = loop_report(evaluation, settings)
        run.write_json("results.json", results)
        run.write_csv("metrics.csv", *metric_rows(results))
        for method in evaluation.methods:
            run.write_csv(f"matches-{method.name}.csv", *loop_records(method))
        drawn = draw_evaluation_figures(run, sequence, evaluation)
    return RunSummary(
        folder=out,
        figures=tuple(out / "figures" / path.name for path in drawn),
        sentence=best_in_words(results, "average_precision", "average precision", sequence.name),
        results=results,
        table=results_table(results),
    )


def _check_names(methods: Sequence[str], imports: Mapping[str, Path]) -> None:
    clash = [name for name in imports if name in methods]
    if clash:
        raise SettingsError(f"--import: {clash[0]!r} is also among the methods; expected another name")


def _training_frames(path: Path) -> list[RangeImage]:
    """Frames of another recording, evenly spread."""
    from depthprint.datasets.registry import open_sequence

    sequence = open_sequence(path)
    return [sequence[index] for index in spread(len(sequence), _MOST_TRAINING_FRAMES)]


def best_in_words(results: dict[str, Any], metric: str, words: str, data: str) -> str:
    """One sentence: which method has the highest figure."""
    scored = {
        name: figures[metric]
        for name, figures in results["methods"].items()
        if figures[metric] == figures[metric]
    }
    where = name_and_kind(data, results["simulated"])
    if not scored:
        return f"On {where} there is nothing to score: no place is visited twice."
    best = max(scored, key=lambda name: scored[name])
    if len(scored) == 1:
        return f"On {where}, {best} reaches {words} {scored[best]:.3f}."
    return f"On {where}, {best} has the highest {words} of {len(scored)} methods: {scored[best]:.3f}."
