"""The families of comparisons, one module each, and how one is run."""

from __future__ import annotations

from importlib import import_module

from benchmarks.harness import Settings

__all__ = ["FAMILIES", "names_of", "run_family"]

FAMILIES = ("emd_pairs", "search", "coding", "learning", "matrix", "online", "recognise")


def names_of(family: str) -> tuple[str, ...]:
    """Names of a family's comparisons."""
    names: tuple[str, ...] = import_module(f"benchmarks.{family}").NAMES
    return names


def run_family(family: str, wanted: set[str], quick: bool, n_threads: int) -> list[dict[str, object]]:
    """Run one family in this process; rows as JSON values, each with its name."""
    rows = import_module(f"benchmarks.{family}").run(Settings(quick, n_threads), wanted)
    return [{"name": row.name, **row.as_json()} for row in rows]
