"""The demo: the main job on a small simulated town."""

from __future__ import annotations

from pathlib import Path

from depthprint.runs.loops import run_loops
from depthprint.runs.source import DataSource
from depthprint.runs.stages import RunSummary, Stages, silent

__all__ = ["run_demo"]

# The shipped models learned from towns of other seeds.
_TOWN = 2015
_LENGTH_M = 800.0


def run_demo(out: Path, *, seed: int = 0, stages: Stages = silent) -> RunSummary:
    """Drive the built-in route through a simulated town and find its loops, as ``run_loops`` would.

    ``seed`` moves the drive to another town.
    """
    source = DataSource(dataset="simulated_street", seed=_TOWN + seed, length_m=_LENGTH_M)
    return run_loops(source, out, seed=seed, stages=stages)
