"""How a finished run is printed."""

from __future__ import annotations

import typer

from depthprint.runs.stages import RunSummary

__all__ = ["print_run"]


def print_run(run: RunSummary) -> None:
    """Print the table of a run, where its files are, and its one sentence."""
    if run.table is not None:
        from rich.console import Console

        Console().print(run.table)
    typer.echo(f"results: {run.folder / 'results.json'}")
    for figure in run.figures:
        typer.echo(f"figure:  {figure}")
    typer.echo(run.sentence)
