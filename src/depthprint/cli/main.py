"""The ``depthprint`` command: its verbs, one file each, and how a known error ends it."""

from __future__ import annotations

import logging
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from depthprint._version import __version__
from depthprint.cli import (
    classify,
    demo,
    encode,
    evaluate,
    explain,
    info,
    loops,
    simulate,
    train,
    train_objects,
)
from depthprint.cli import map as map_verbs
from depthprint.errors import DepthprintError

__all__ = ["app", "main"]


class _Notices(logging.Handler):
    """Keeps what the package logs until the command has ended well: an error then stands alone on stderr."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: dict[str, None] = {}

    def emit(self, record: logging.LogRecord) -> None:
        self.lines[f"depthprint: note: {record.getMessage()}"] = None


class _OneLineErrors(TyperGroup):
    """An error raised on purpose ends the command with one line on stderr and status 2; a crash, with a traceback."""

    def invoke(self, ctx: Any) -> Any:
        notices = _Notices()
        logger = logging.getLogger("depthprint")
        logger.addHandler(notices)
        try:
            result = super().invoke(ctx)
        except DepthprintError as error:
            reason = str(error)
        except OSError as error:
            if error.filename is None:
                raise
            reason = f"{error.filename}: {error.strerror}"
        else:
            for line in notices.lines:
                typer.echo(line, err=True)
            return result
        finally:
            logger.removeHandler(notices)
        typer.echo(f"depthprint: error: {' '.join(reason.split())}", err=True)
        raise typer.Exit(2)


app = typer.Typer(
    name="depthprint",
    cls=_OneLineErrors,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("demo")(demo.demo)
app.command("loops")(loops.loops)
app.command("classify")(classify.classify)
app.command("train")(train.train)
app.command("train-objects")(train_objects.train_objects)
app.command("encode")(encode.encode)
app.add_typer(evaluate.app, name="evaluate")
app.add_typer(map_verbs.app, name="map")
app.command("simulate")(simulate.simulate)
app.command("explain")(explain.explain)
app.command("info")(info.info)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"depthprint {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and leave."
        ),
    ] = False,
) -> None:
    """Recognise places and objects from depth alone."""


def main() -> None:
    """Run the command line; the installed ``depthprint`` script."""
    app(prog_name="depthprint")
