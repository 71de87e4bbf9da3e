"""Progress bars on stderr for whatever takes more than two seconds."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from depthprint.runs.stages import ProgressCallback, Stages

__all__ = ["progress_bars"]

_QUIET_S = 2.0


@contextmanager
def progress_bars() -> Iterator[Stages]:
    """Yield a function that names a stage and gives its ``progress(done, total)``; a bar shows after two seconds."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    # Where stderr is a file or a pipe, even an empty display would leave a line there.
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bars:

        def stage(name: str) -> ProgressCallback:
            started = time.monotonic()
            task = bars.add_task(name, total=None, visible=False)

            def update(done: int, total: int) -> None:
                slow = time.monotonic() - started > _QUIET_S
                bars.update(task, completed=done, total=total, visible=slow and done < total)

            return update

        yield stage
