"""``depthprint map``: places kept on disk, and frames found among them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from depthprint.cli import options as o
from depthprint.cli.printing import print_run
from depthprint.cli.progress import progress_bars

if TYPE_CHECKING:
    from depthprint.runs import MapSummary

__all__ = ["app"]

app = typer.Typer(
    help="Keep places in a map, one file, and find frames in it.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

MapFile = Annotated[Path, typer.Argument(metavar="MAP", help="A map file.")]
NewMap = Annotated[Path, typer.Option("--out", "-o", metavar="MAP", help="New map file to write.")]


@app.command("build")
def build(
    out: NewMap,
    data: o.Data = None,
    dataset: o.Dataset = None,
    sequence: o.Sequence = None,
    preset: o.Preset = None,
    model: o.Model = None,
    voxel_m: Annotated[
        float | None,
        typer.Option(
            "--points", metavar="METRES", help="Keep each frame's points too, one a voxel of this side."
        ),
    ] = None,
    poses: o.Poses = None,
    seed: o.Seed = 0,
    cars_redrawn: o.CarsRedrawn = 0.2,
    sensor: o.Sensor = None,
    every: o.Every = 1,
) -> None:
    """Describe every frame of a recording and keep it as a place."""
    from depthprint.runs import DataSource, run_map_build

    source = DataSource(data, dataset, sequence, every, seed, poses, cars_redrawn, sensor)
    with progress_bars() as stages:
        made = run_map_build(source, out, preset=preset, model=model, voxel_m=voxel_m, stages=stages)
    _print_map(made)


@app.command("localise")
def localise(
    out: o.OutFolder,
    map_file: Annotated[Path, typer.Option("--map", metavar="MAP", help="The map to look in.")],
    data: o.Data = None,
    dataset: o.Dataset = None,
    sequence: o.Sequence = None,
    threshold: Annotated[
        float | None,
        typer.Option(
            "--threshold", metavar="T", help="Largest distance to a place; set from the map when absent."
        ),
    ] = None,
    poses: o.Poses = None,
    seed: o.Seed = 0,
    cars_redrawn: o.CarsRedrawn = 0.2,
    sensor: o.Sensor = None,
    every: o.Every = 1,
) -> None:
    """Find each frame of a recording in a map that was built from another."""
    from depthprint.runs import DataSource, run_map_localise

    source = DataSource(data, dataset, sequence, every, seed, poses, cars_redrawn, sensor)
    with progress_bars() as stages:
        run = run_map_localise(source, map_file, out, threshold=threshold, stages=stages)
    print_run(run)


@app.command("merge")
def merge(
    first: MapFile,
    second: Annotated[Path, typer.Argument(metavar="MAP", help="Another, made by the same model.")],
    out: NewMap,
) -> None:
    """Join two maps of one model to a new one; poses stay as they are."""
    from depthprint.runs import run_map_merge

    with progress_bars() as stages:
        made = run_map_merge(first, second, out, stages=stages)
    _print_map(made)


@app.command("info")
def info(map_file: MapFile) -> None:
    """Read a map through, checking all of it, and say what it holds."""
    from depthprint.runs import run_map_info

    _print_map(run_map_info(map_file))


def _print_map(made: MapSummary) -> None:
    points = "none" if made.voxel_m is None else f"one a voxel of {made.voxel_m:g} m"
    typer.echo(f"map          {made.path}")
    typer.echo(f"places       {made.n_places}, {made.n_posed} with a pose")
    typer.echo(f"points       {points}")
    for name in made.runs:
        typer.echo(f"run          {name or 'without a name'}")
    typer.echo(f"model        {made.preset}, fingerprint {made.fingerprint}")
