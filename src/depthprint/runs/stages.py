"""What the runs share: progress by named stages, and the summary of a finished run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["ProgressCallback", "RunSummary", "Stages", "silent"]

ProgressCallback = Callable[[int, int], None]
Stages = Callable[[str], ProgressCallback]


def silent(name: str) -> ProgressCallback:
    """Give a stage that reports to nobody."""

    def update(done: int, total: int) -> None:
        """Ignore the report."""

    return update


@dataclass(frozen=True)
class RunSummary:
    """A finished run.

    folder: where everything lies. figures: paths of the PNG files. sentence: what was found, in plain words.
    table: a rich table of the scores, or None where there are none. results: the content of results.json.
    """

    folder: Path
    figures: tuple[Path, ...]
    sentence: str
    results: dict[str, Any]
    table: Any = None
