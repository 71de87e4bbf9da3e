"""``depthprint info``: what is installed, or what a model file holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["info"]


def info(
    path: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="A model, dictionary or signature file.")
    ] = None,
) -> None:
    """Print versions, presets, data sets and methods, or the content of a file."""
    from depthprint.runs import describe_file, describe_installation

    facts = describe_installation() if path is None else describe_file(path)
    width = max(len(name) for name in facts)
    for name, value in facts.items():
        typer.echo(f"{name:{width}}  {value}")
