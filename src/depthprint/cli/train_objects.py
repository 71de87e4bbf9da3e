"""``depthprint train-objects``: a recogniser from a folder of labelled depth images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from depthprint.cli import options as o
from depthprint.cli.progress import progress_bars

__all__ = ["train_objects"]


def train_objects(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="One sub-folder of depth images per class.")
    ],
    out: o.OutFile,
    preset: o.Preset = None,
    model: o.Model = None,
    seed: o.Seed = 0,
) -> None:
    """Learn to recognise your own objects, or kinds of places with a preset for places, and save it."""
    from depthprint.runs import run_train_objects

    with progress_bars() as stages:
        trained = run_train_objects(folder, out, preset=preset, model=model, seed=seed, stages=stages)
    typer.echo(
        f"{trained.path}: preset {trained.preset}, {len(trained.classes)} classes, {trained.n_views} views"
    )
    if not trained.knows_unknown:
        typer.echo(
            "note: three classes of two objects each are needed to learn when to answer 'none of these'"
        )
