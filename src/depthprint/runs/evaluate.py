"""Measure methods side by side by the protocols, and write what came out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from depthprint.errors import DataError
from depthprint.runs.loops import truth_with_gap
from depthprint.runs.models import choose_model
from depthprint.runs.source import DataSource
from depthprint.runs.stages import RunSummary, Stages, silent

__all__ = ["run_evaluate_loops", "run_evaluate_objects"]


def run_evaluate_loops(
    source: DataSource,
    out: Path,
    *,
    methods: Sequence[str],
    preset: str | None = None,
    model: Path | None = None,
    gap: int | None = None,
    seed: int = 0,
    stages: Stages = silent,
) -> RunSummary:
    """Score methods on the loops of a recording with poses; one CSV of matches per method.

    Raises DataError when there are no poses, SettingsError for an unknown method, and as its parts do.
    """
    from depthprint.evaluation.ground_truth import loop_ground_truth
    from depthprint.evaluation.loops import evaluate_loops
    from depthprint.evaluation.report import loop_records, loop_report, metric_rows, results_table
    from depthprint.place_methods import make_place_recognizer
    from depthprint.run_folder import RunFolder
    from depthprint.runs.loop_figures import draw_evaluation_figures

    sequence = truth_with_gap(source.open(stages("make the world")), gap)
    if sequence.poses is None:
        raise DataError(
            f"{sequence.name}: expected poses to score with, found none; 'depthprint loops' needs none"
        )
    name, encoder = choose_model(model, preset, sequence.preset)
    recognizers = {method: make_place_recognizer(method, name, encoder) for method in methods}
    settings = {
        "data": source.settings(),
        "methods": list(methods),
        "preset": name,
        "model": None if model is None else str(model),
        "gap": sequence.truth.gap,
    }
    with RunFolder(out, settings, seed=seed) as run:
        truth = loop_ground_truth(sequence, sequence.truth, stages("ground truth"))
        evaluation = evaluate_loops(
            sequence, recognizers, truth, seed=seed, progress=stages("describe and query")
        )
        results = loop_report(evaluation, settings)
        run.write_json("results.json", results)
        run.write_csv("metrics.csv", *metric_rows(results))
        for method in evaluation.methods:
            run.write_csv(f"matches-{method.name}.csv", *loop_records(method))
        drawn = draw_evaluation_figures(run, sequence, evaluation)
    return RunSummary(
        folder=out,
        figures=tuple(out / "figures" / path.name for path in drawn),
        sentence=_best(results, "average_precision", "average precision", sequence.name),
        results=results,
        table=results_table(results),
    )


def run_evaluate_objects(
    root: Path,
    out: Path,
    *,
    methods: Sequence[str],
    frames: Sequence[int] | None = None,
    preset: str | None = None,
    model: Path | None = None,
    seed: int = 0,
    stages: Stages = silent,
) -> RunSummary:
    """Score methods on the categories and instances of a set of objects in the UW RGB-D layout.

    ``frames`` takes those views of each turn only. Raises DataError, SettingsError as its parts do.
    """
    from depthprint.datasets.registry import open_objects
    from depthprint.evaluation.objects import evaluate_objects
    from depthprint.evaluation.report import metric_rows, object_report, object_rows, results_table
    from depthprint.object_methods import make_object_methods
    from depthprint.run_folder import RunFolder
    from depthprint.visualization.confusion_matrix import draw_confusion_matrix

    objects = open_objects(root)
    name, encoder = choose_model(model, preset, "object")
    prepared = make_object_methods(methods, name, encoder)
    settings = {
        "data": {"path": str(root)},
        "methods": list(methods),
        "preset": name,
        "model": None if model is None else str(model),
        "frames": None if frames is None else list(frames),
    }
    with RunFolder(out, settings, seed=seed) as run:
        evaluation = evaluate_objects(
            objects, prepared, seed=seed, frames=frames, progress=stages("describe and compare")
        )
        results = object_report(evaluation, settings)
        run.write_json("results.json", results)
        run.write_csv("metrics.csv", *metric_rows(results))
        run.write_csv("predictions.csv", *object_rows(evaluation))
        drawn = [
            draw_confusion_matrix(
                evaluation.confusion(method),
                evaluation.categories,
                run.figure(f"confusion-{method.name}"),
                method=method.name,
                data=objects.name,
                simulated=objects.simulated,
            )
            for method in evaluation.methods
        ]
    return RunSummary(
        folder=out,
        figures=tuple(out / "figures" / path.name for path in drawn),
        sentence=_best(results, "category_accuracy_mean", "category accuracy", objects.name),
        results=results,
        table=results_table(results),
    )


def _best(results: dict[str, Any], metric: str, words: str, data: str) -> str:
    scored = {
        name: figures[metric]
        for name, figures in results["methods"].items()
        if figures[metric] == figures[metric]
    }
    if not scored:
        return f"On {data} there is nothing to score: no place is visited twice."
    best = max(scored, key=lambda name: scored[name])
    kind = "simulated" if results["simulated"] else "recorded"
    if len(scored) == 1:
        return f"On {data} ({kind}), {best} reaches {words} {scored[best]:.3f}."
    return f"On {data} ({kind}), {best} has the highest {words} of {len(scored)} methods: {scored[best]:.3f}."
