"""``depthprint train``: learn an encoder's dictionaries from a sequence or a set of objects."""

from __future__ import annotations

import typer

from depthprint.cli import options as o
from depthprint.cli.progress import progress_bars

__all__ = ["train"]


def train(
    out: o.OutFile,
    data: o.Data = None,
    dataset: o.Dataset = None,
    sequence: o.Sequence = None,
    preset: o.Preset = None,
    poses: o.Poses = None,
    seed: o.Seed = 0,
    cars_redrawn: o.CarsRedrawn = 0.2,
    sensor: o.Sensor = None,
    every: o.Every = 1,
) -> None:
    """Train a model on depth and save it."""
    from depthprint.runs import DataSource, run_train

    source = DataSource(data, dataset, sequence, every, seed, poses, cars_redrawn, sensor)
    with progress_bars() as stages:
        trained = run_train(source, out, preset=preset, seed=seed, stages=stages)
    typer.echo(f"{trained.path}: preset {trained.preset}, {trained.n_images} images of {trained.data}")
    typer.echo(f"fingerprint {trained.fingerprint}")
