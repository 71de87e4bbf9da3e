"""``depthprint demo``: the main job on a small simulated world, in a few minutes."""

from __future__ import annotations

from pathlib import Path

from depthprint.cli import options as o
from depthprint.cli.printing import print_run
from depthprint.cli.progress import progress_bars

__all__ = ["demo"]


def demo(out: o.OutFolder = Path("demo-run"), seed: o.Seed = 0) -> None:
    """Drive through a simulated town, find the loops, and show them."""
    from depthprint.runs import run_demo

    with progress_bars() as stages:
        run = run_demo(out, seed=seed, stages=stages)
    print_run(run)
