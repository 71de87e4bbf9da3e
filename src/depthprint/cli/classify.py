"""``depthprint classify``: the nearest classes of one depth image."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from depthprint.cli import options as o
from depthprint.cli.progress import progress_bars

__all__ = ["classify"]


def classify(
    query: Annotated[Path, typer.Argument(metavar="QUERY", help="Depth image of the object to name.")],
    against: o.Against,
    model: o.Model = None,
    preset: o.Preset = None,
    k: Annotated[int, typer.Option("-k", min=1, metavar="K", help="How many classes to print.")] = 5,
) -> None:
    """Print the classes nearest to a depth image, with their distances."""
    from depthprint.runs import run_classify

    with progress_bars() as stages:
        nearest = run_classify(query, against, preset=preset, model=model, k=k, stages=stages)
    width = max(len("class"), *(len(match.label) for match in nearest))
    typer.echo(f"{'class':{width}}  distance  nearest example")
    for match in nearest:
        typer.echo(f"{match.label:{width}}  {match.distance:8.4f}  {match.example}")
