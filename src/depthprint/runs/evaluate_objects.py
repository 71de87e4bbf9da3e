"""Measure methods on objects, and write what came out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from depthprint.runs.evaluate import best_in_words
from depthprint.runs.models import choose_model
from depthprint.runs.stages import RunSummary, Stages, silent

if TYPE_CHECKING:
    from depthprint.datasets.base import ObjectSet
    from depthprint.evaluation.object_methods import ObjectMethod
    from depthprint.evaluation.objects import ObjectEvaluation, ObjectProtocol
    from depthprint.run_folder import RunFolder

__all__ = ["ObjectQueries", "run_evaluate_objects"]

PUBLISHED_TRIALS = "testinstance_ids.txt"
QUICK_CATEGORIES = 8
SHOWN_QUERIES = 4
SHOWN_NEIGHBOURS = 5


@dataclass(frozen=True)
class ObjectQueries:
    """Which views are taken and what a query is.

    frames: these views of each turn only. every: of each turn's frames 1, 2, 3, ... each n-th. views: views a query.
    hidden: share of each query's object that is hidden. trials: random trials, 0 for every object once. quick: every
    eighth category and the first view of each turn.
    """

    frames: Sequence[int] | None = None
    every: int = 1
    views: int = 1
    hidden: float = 0.0
    trials: int = 0
    quick: bool = False


def run_evaluate_objects(
    root: Path,
    out: Path,
    *,
    methods: Sequence[str] | None = None,
    queries: ObjectQueries = ObjectQueries(),
    preset: str | None = None,
    model: Path | None = None,
    seed: int = 0,
    stages: Stages = silent,
) -> RunSummary:
    """Score methods (None: the whole table) on the categories and instances of a set in the UW RGB-D layout.

    Where the set has a testinstance_ids.txt, its published trials are run, unless random ones are asked for. Raises
    DataError, SettingsError as its parts do.
    """
    from depthprint.datasets.registry import open_objects
    from depthprint.evaluation.objects import evaluate_objects
    from depthprint.evaluation.report import (
        accuracy_rows,
        metric_rows,
        object_report,
        object_rows,
        results_table,
    )
    from depthprint.objects.methods import make_object_methods, table_methods
    from depthprint.run_folder import RunFolder
    from depthprint.visualization.confusion_matrix import draw_confusion_matrix

    objects = open_objects(root, every=queries.every)
    protocol = _protocol(root, objects, queries)
    frames = queries.frames
    if queries.quick:
        objects, frames = _subset(objects, queries)
    name, encoder = choose_model(model, preset, "object")
    names = table_methods() if methods is None else methods
    prepared = make_object_methods(names, name, encoder)
    settings = {
        "data": {"path": str(root)},
        "methods": list(names),
        "preset": name,
        "model": None if model is None else str(model),
        "queries": asdict(queries),
    }
    with RunFolder(out, settings, seed=seed) as run:
        evaluation = evaluate_objects(
            objects,
            prepared,
            seed=seed,
            frames=frames,
            protocol=protocol,
            progress=stages("describe and compare"),
        )
        results = object_report(evaluation, settings)
        run.write_json("results.json", results)
        run.write_csv("metrics.csv", *metric_rows(results))
        run.write_csv("predictions.csv", *object_rows(evaluation))
        run.write_csv("objects.csv", *accuracy_rows(evaluation))
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
        drawn += _draw_neighbours(run, objects, evaluation, prepared)
    return RunSummary(
        folder=out,
        figures=tuple(out / "figures" / path.name for path in drawn),
        sentence=best_in_words(results, "category_accuracy_mean", "category accuracy", objects.name),
        results=results,
        table=results_table(results),
    )


def _protocol(root: Path, objects: ObjectSet, queries: ObjectQueries) -> ObjectProtocol:
    from depthprint.datasets.uw_rgbd_object import read_category_trials
    from depthprint.evaluation.objects import ObjectProtocol

    published: tuple[tuple[str, ...], ...] = ()
    if not queries.trials and (root / PUBLISHED_TRIALS).is_file():
        published = read_category_trials(root / PUBLISHED_TRIALS, objects)
    return ObjectProtocol(queries.views, queries.hidden, queries.trials, published)


def _subset(objects: ObjectSet, queries: ObjectQueries) -> tuple[ObjectSet, Sequence[int]]:
    """Every eighth category, and as few views of each turn as a query needs."""
    kept = sorted({view.category for view in objects.views})[::QUICK_CATEGORIES]
    views = [view for view in objects.views if view.category in kept]
    return replace(objects, views=views), sorted({view.frame for view in views})[: queries.views]


def _draw_neighbours(
    run: RunFolder, objects: ObjectSet, evaluation: ObjectEvaluation, methods: Sequence[ObjectMethod]
) -> list[Path]:
    """Draw whole queries of the first fold with their nearest views, as many right ones as wrong, for one method."""
    from depthprint.evaluation.object_methods import NeighbourMethod
    from depthprint.visualization.neighbours import NeighbourRow, draw_neighbours

    chosen = next((m for m in methods if isinstance(m, NeighbourMethod)), None)
    if chosen is None:
        return []
    train, test = evaluation.protocol.splits(evaluation.views, evaluation.seed)[0]
    nearest = chosen.neighbours(train, test, min(SHOWN_NEIGHBOURS, len(train)))
    views = evaluation.views
    right = np.array(
        [views[t].category == views[n[0]].category for t, n in zip(test, nearest, strict=True)], dtype=bool
    )
    generator = np.random.default_rng(evaluation.seed)
    rows = []
    for kind in (True, False):
        found = np.flatnonzero(right == kind)
        for position in generator.permutation(found)[:SHOWN_QUERIES]:
            shown = [int(test[position]), *(int(n) for n in nearest[position])]
            rows.append(
                NeighbourRow(
                    tuple(objects.read(views[n]) for n in shown), tuple(views[n].category for n in shown)
                )
            )
    path = draw_neighbours(
        rows,
        run.figure("neighbours"),
        method=getattr(chosen, "name", ""),
        data=objects.name,
        simulated=objects.simulated,
    )
    return [path]
