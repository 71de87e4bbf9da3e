"""``depthprint simulate``: write a simulated drive as files."""

from __future__ import annotations

import typer

from depthprint.cli import options as o
from depthprint.cli.progress import progress_bars

__all__ = ["simulate"]


def simulate(
    out: o.OutFolder,
    dataset: o.Dataset = "simulated-street",
    poses: o.Poses = None,
    seed: o.Seed = 0,
    cars_redrawn: o.CarsRedrawn = 0.2,
    sensor: o.Sensor = None,
    every: o.Every = 1,
) -> None:
    """Write the frames, poses and camera of a simulated world to a folder that the other verbs read."""
    from depthprint.runs import DataSource, run_simulate

    source = DataSource(None, dataset, None, every, seed, poses, cars_redrawn, sensor)
    with progress_bars() as stages:
        written = run_simulate(source, out, stages=stages)
    typer.echo(f"{written.path}: {written.n_images} frames of {written.data}")
