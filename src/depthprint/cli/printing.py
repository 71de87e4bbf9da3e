"""How a finished run is printed."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import typer

from depthprint.runs.stages import RunSummary

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

__all__ = ["print_run"]

_WIDEST = 200


def print_run(run: RunSummary) -> None:
    """Print the table of a run, where its files are, and its one sentence."""
    if run.table is not None:
        _console(run.table).print(run.table)
    typer.echo(f"results: {run.folder / 'results.json'}")
    for figure in run.figures:
        typer.echo(f"figure:  {figure}")
    typer.echo(run.sentence)


def _console(table: Table) -> Console:
    """A console; into a file or a pipe, one that is wide enough for the whole table."""
    from rich.console import Console

    console = Console()
    if console.is_terminal or "COLUMNS" in os.environ:
        return console
    needed = console.measure(table, options=console.options.update(max_width=_WIDEST)).maximum
    return Console(width=max(console.width, needed))
