"""``depthprint loops``: find the places that a sequence visits again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from depthprint.cli import options as o
from depthprint.cli.printing import print_run
from depthprint.cli.progress import progress_bars

__all__ = ["loops"]


def loops(
    out: o.OutFolder,
    data: o.Data = None,
    dataset: o.Dataset = None,
    sequence: o.Sequence = None,
    preset: o.Preset = None,
    model: o.Model = None,
    threshold: Annotated[
        float | None,
        typer.Option(
            "--threshold", metavar="T", help="Largest distance of a loop; set from the data when absent."
        ),
    ] = None,
    gap: o.Gap = None,
    odometry: Annotated[
        Path | None,
        typer.Option(
            "--odometry", metavar="FILE", help="Odometry poses for graph.g2o; the poses of DATA when absent."
        ),
    ] = None,
    poses: o.Poses = None,
    seed: o.Seed = 0,
    cars_redrawn: o.CarsRedrawn = 0.2,
    sensor: o.Sensor = None,
    every: o.Every = 1,
) -> None:
    """Find loops in a sequence of depth, and score them where poses are known."""
    from depthprint.runs import DataSource, run_loops

    source = DataSource(data, dataset, sequence, every, seed, poses, cars_redrawn, sensor)
    with progress_bars() as stages:
        run = run_loops(
            source,
            out,
            preset=preset,
            model=model,
            threshold=threshold,
            gap=gap,
            odometry=odometry,
            seed=seed,
            stages=stages,
        )
    print_run(run)
