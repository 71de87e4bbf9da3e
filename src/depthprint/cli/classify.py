"""``depthprint classify``: the class of a depth image, by its nearest examples or by a trained recogniser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from depthprint.cli import options as o
from depthprint.cli.progress import progress_bars
from depthprint.errors import SettingsError

__all__ = ["classify"]


def classify(
    queries: Annotated[
        list[Path],
        typer.Argument(
            metavar="QUERY...",
            help="Depth image of the object to name; with a recogniser, several views of one object.",
        ),
    ],
    against: Annotated[
        Path | None,
        typer.Option(
            "--against", metavar="FOLDER", help="One sub-folder of depth images per class, or the UW layout."
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model", metavar="MODEL", help="Recogniser of train-objects; with --against, a model of train."
        ),
    ] = None,
    preset: o.Preset = None,
    k: Annotated[int, typer.Option("-k", min=1, metavar="K", help="How many classes to print.")] = 5,
) -> None:
    """Print the classes that a depth image is of, most likely first."""
    if against is not None:
        if len(queries) > 1:
            raise SettingsError(f"--against compares one depth image, got {len(queries)}")
        _by_examples(queries[0], against, model, preset, k)
    elif model is not None and preset is None:
        _by_recogniser(queries, model, k)
    else:
        raise SettingsError(
            "classify: expected --against FOLDER, or --model MODEL (of train-objects) without --preset"
        )


def _by_examples(query: Path, against: Path, model: Path | None, preset: str | None, k: int) -> None:
    from depthprint.runs import run_classify

    with progress_bars() as stages:
        nearest = run_classify(query, against, preset=preset, model=model, k=k, stages=stages)
    width = max(len("class"), *(len(match.label) for match in nearest))
    typer.echo(f"{'class':{width}}  distance  nearest example")
    for match in nearest:
        typer.echo(f"{match.label:{width}}  {match.distance:8.4f}  {match.example}")


def _by_recogniser(queries: list[Path], model: Path, k: int) -> None:
    from depthprint.runs import run_recognise

    found = run_recognise(queries, model)
    none = "none of these"
    outcomes = sorted([*found.classes[:k], (none, found.none_probability)], key=lambda pair: -pair[1])
    width = max(len(label) for label, _ in outcomes)
    typer.echo(f"{found.label or none}, probability {found.confidence:.2f}; nearest view {found.nearest}")
    for label, probability in outcomes:
        typer.echo(f"{label:{width}}  {probability:11.3f}")
