"""``depthprint evaluate loops`` and ``evaluate objects``: the protocols, for any methods."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from depthprint.cli import options as o
from depthprint.cli.printing import print_run
from depthprint.cli.progress import progress_bars

__all__ = ["app"]

app = typer.Typer(
    help="Measure methods, all by the same protocol.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("loops")
def loops(
    out: o.OutFolder,
    data: o.Data = None,
    methods: o.Methods = "emd,pixel-l2",
    dataset: o.Dataset = None,
    sequence: o.Sequence = None,
    preset: o.Preset = None,
    model: o.Model = None,
    gap: o.Gap = None,
    poses: o.Poses = None,
    seed: o.Seed = 0,
    cars_redrawn: o.CarsRedrawn = 0.2,
    sensor: o.Sensor = None,
    every: o.Every = 1,
    imports: o.Imports = None,
    vocabulary_from: o.VocabularyFrom = None,
    delay: o.Delay = 0,
) -> None:
    """Score methods on the loops of a sequence with poses."""
    from depthprint.runs import DataSource, run_evaluate_loops

    files = o.parse_imports(imports)
    names = o.parse_methods(methods, may_be_none=bool(files))
    source = DataSource(data, dataset, sequence, every, seed, poses, cars_redrawn, sensor)
    with progress_bars() as stages:
        run = run_evaluate_loops(
            source,
            out,
            methods=names,
            preset=preset,
            model=model,
            gap=gap,
            delay=delay,
            imports=files,
            vocabulary_from=vocabulary_from,
            seed=seed,
            stages=stages,
        )
    print_run(run)


@app.command("objects")
def objects(
    root: Annotated[Path, typer.Argument(metavar="ROOT", help="Object views in the UW RGB-D layout.")],
    out: o.OutFolder,
    methods: Annotated[
        str,
        typer.Option("--methods", metavar="A,B,C", help="Methods, separated by commas; all of the table's."),
    ] = "",
    frames: o.Frames = None,
    every: o.Every = 1,
    views: o.Views = 1,
    hidden: o.Hidden = 0.0,
    trials: o.Trials = 0,
    quick: o.Quick = False,
    preset: o.Preset = None,
    model: o.Model = None,
    seed: o.Seed = 0,
) -> None:
    """Score methods on the categories and instances of objects; without --methods, the whole table."""
    from depthprint.runs import ObjectQueries, run_evaluate_objects

    names = o.parse_methods(methods) if methods else None
    numbers = o.parse_frames(frames)
    with progress_bars() as stages:
        run = run_evaluate_objects(
            root,
            out,
            methods=names,
            queries=ObjectQueries(numbers, every, views, hidden, trials, quick),
            preset=preset,
            model=model,
            seed=seed,
            stages=stages,
        )
    print_run(run)
