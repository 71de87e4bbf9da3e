"""``depthprint explain``: why two depth images are near or far."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from depthprint.cli import options as o

__all__ = ["explain"]


def explain(
    first: Annotated[Path, typer.Argument(metavar="A", help="One depth image.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another.")],
    out: o.OutFile = Path("explain.png"),
    preset: o.Preset = None,
    model: o.Model = None,
) -> None:
    """Print distance and complexities stream by stream, and draw what flows between the two images."""
    from depthprint.runs import run_explain

    explained = run_explain(first, second, out, preset=preset, model=model)
    typer.echo(f"distance {explained.distance:.4f} (0 for an image and itself)")
    for stream in explained.streams:
        typer.echo(
            f"{stream.name}: distance {stream.distance:.4f}, weight {stream.weight:g}, EMD {stream.emd:.4f}, "
            f"K(A) {stream.complexity_first:.4f}, K(B) {stream.complexity_second:.4f}"
        )
    typer.echo(f"flow: {explained.figure}")
