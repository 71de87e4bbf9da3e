"""``depthprint encode``: write the signatures of a sequence."""

from __future__ import annotations

import typer

from depthprint.cli import options as o
from depthprint.cli.progress import progress_bars

__all__ = ["encode"]


def encode(
    out: o.OutFile,
    data: o.Data = None,
    model: o.Model = None,
    dataset: o.Dataset = None,
    sequence: o.Sequence = None,
    preset: o.Preset = None,
    poses: o.Poses = None,
    seed: o.Seed = 0,
    cars_redrawn: o.CarsRedrawn = 0.2,
    sensor: o.Sensor = None,
    every: o.Every = 1,
) -> None:
    """Write every frame's signatures to one .npz file."""
    from depthprint.runs import DataSource, run_encode

    source = DataSource(data, dataset, sequence, every, seed, poses, cars_redrawn, sensor)
    with progress_bars() as stages:
        encoded = run_encode(source, out, preset=preset, model=model, stages=stages)
    typer.echo(f"{encoded.path}: {encoded.n_images} images, streams {', '.join(encoded.streams)}")
    typer.echo(f"fingerprint {encoded.fingerprint}")
