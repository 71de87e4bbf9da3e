"""Options that several verbs share, declared once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from depthprint.errors import SettingsError

__all__ = [
    "CarsRedrawn",
    "Data",
    "Dataset",
    "Every",
    "Frames",
    "Gap",
    "Hidden",
    "Imports",
    "Methods",
    "Model",
    "OutFile",
    "OutFolder",
    "Poses",
    "Preset",
    "Quick",
    "Seed",
    "Sensor",
    "Sequence",
    "Trials",
    "Views",
    "VocabularyFrom",
    "parse_frames",
    "parse_imports",
    "parse_methods",
]

_SIMULATED = "Simulated street: "

Data = Annotated[
    Path | None, typer.Argument(metavar="DATA", help="File or folder of depth; none for simulated data.")
]
Dataset = Annotated[
    str | None,
    typer.Option("--dataset", metavar="NAME", help="Kind of data; guessed from the path when absent."),
]
Sequence = Annotated[
    str | None,
    typer.Option("--sequence", "-s", metavar="SEQ", help="Sequence of a data set that has several."),
]
Every = Annotated[int, typer.Option("--every", min=1, metavar="K", help="Take every K-th frame.")]
Poses = Annotated[
    Path | None,
    typer.Option(
        "--poses", metavar="FILE", help="Pose file: the path to drive along when simulated, else of DATA."
    ),
]
Seed = Annotated[int, typer.Option("--seed", min=0, metavar="N", help="Seed of everything random.")]
CarsRedrawn = Annotated[
    float,
    typer.Option(
        "--cars-redrawn",
        min=0.0,
        max=1.0,
        metavar="SHARE",
        help=_SIMULATED + "share of parked cars redrawn between visits.",
    ),
]
Sensor = Annotated[
    str | None,
    typer.Option(
        "--sensor",
        metavar="stereo|kinect|lidar|...",
        help="Kind of sensor when simulated; stereo or lidar of KITTI.",
    ),
]
Preset = Annotated[
    str | None,
    typer.Option("--preset", metavar="NAME", help="Encoder preset; the preset of the data when absent."),
]
Model = Annotated[
    Path | None, typer.Option("--model", metavar="MODEL", help="Trained model; the shipped one when absent.")
]
Gap = Annotated[
    int | None,
    typer.Option("--gap", min=0, metavar="N", help="Frame i is compared with frames j where i - j > N."),
]
Delay = Annotated[
    int,
    typer.Option(
        "--delay",
        min=0,
        max=15,
        metavar="N",
        help="Second rows of methods that can answer again after N more frames.",
    ),
]
OutFolder = Annotated[Path, typer.Option("--out", "-o", metavar="OUT", help="Folder to write.")]
OutFile = Annotated[Path, typer.Option("--out", "-o", metavar="OUT", help="File to write.")]
Methods = Annotated[str, typer.Option("--methods", metavar="A,B,C", help="Methods, separated by commas.")]
Imports = Annotated[
    list[str] | None,
    typer.Option(
        "--import",
        metavar="NAME=FILE.csv",
        help="Another program's matches, columns query, match, score, scored beside the methods; may be repeated. "
        "'--methods none' scores these alone.",
    ),
]
VocabularyFrom = Annotated[
    Path | None,
    typer.Option(
        "--vocabulary-from",
        metavar="DATA",
        help="Another recording, from which fabmap2 learns; its shipped vocabulary when absent.",
    ),
]
Frames = Annotated[
    str | None, typer.Option("--frames", metavar="1,4,7", help="Only these views of each turn of an object.")
]
Views = Annotated[
    int,
    typer.Option("--views", min=1, metavar="N", help="Views a query: consecutive ones of a turn, summed."),
]
Hidden = Annotated[
    float,
    typer.Option(
        "--hidden",
        min=0.0,
        max=0.9,
        metavar="SHARE",
        help="Hide this share of each query behind a half-plane.",
    ),
]
Trials = Annotated[
    int,
    typer.Option(
        "--trials",
        min=0,
        metavar="N",
        help="Random trials of the category protocol; 0 tests every object once.",
    ),
]
Quick = Annotated[
    bool, typer.Option("--quick", help="Every eighth category, one view a turn: minutes, not results.")
]


def parse_methods(text: str, *, may_be_none: bool = False) -> list[str]:
    """Split a comma list of method names; raise SettingsError on an empty or a repeated one.

    'none' is the empty list where ``may_be_none``.
    """
    if may_be_none and text.strip() == "none":
        return []
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise SettingsError(f"--methods: expected names separated by commas, got {text!r}")
    if len(set(names)) < len(names):
        raise SettingsError(f"--methods: a name is given twice in {text!r}")
    return names


def parse_imports(given: list[str] | None) -> dict[str, Path]:
    """Split NAME=FILE pairs; raise SettingsError on one without a name or file, and on a repeated name."""
    files: dict[str, Path] = {}
    for text in given or ():
        name, _, file = text.partition("=")
        if not name or not file or "/" in name:
            raise SettingsError(f"--import: expected NAME=FILE.csv, got {text!r}")
        if name in files:
            raise SettingsError(f"--import: the name {name!r} is given twice")
        files[name] = Path(file)
    return files


def parse_frames(text: str | None) -> list[int] | None:
    """Split a comma list of frame numbers; raise SettingsError on anything else. None stays None."""
    if text is None:
        return None
    try:
        frames = [int(part) for part in text.split(",")]
    except ValueError:
        raise SettingsError(f"--frames: expected numbers separated by commas, got {text!r}") from None
    if len(set(frames)) < len(frames) or min(frames) < 0:
        raise SettingsError(f"--frames: expected distinct numbers >= 0, got {text!r}")
    return frames
