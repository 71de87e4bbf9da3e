"""One look for all figures: colours that colour-blind readers can tell apart, sizes that survive a README."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from depthprint.datasets.base import name_and_kind
from depthprint.io.atomic import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["BAD_COLOR", "COLORS", "DEPTH_MAP", "SHARE_MAP", "drawing", "titled"]

# Okabe & Ito's palette without its yellow, which is lost on white
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#7F7F7F")
DEPTH_MAP = "viridis_r"
SHARE_MAP = "Blues"
BAD_COLOR = "#E8E8E8"

_TITLE_CHARACTERS = 68

_STYLE: dict[str, Any] = {
    "font.size": 11,
    "axes.titlesize": 12,
    "axes.labelsize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.titlesize": 12,
    "savefig.facecolor": "white",
}


@contextmanager
def drawing(path: Path | str, width_in: float, height_in: float) -> Iterator[Figure]:
    """Yield an empty figure in the house's style; written to ``path`` when the block ends well."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(_STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        yield figure
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=150)


def titled(what: str, data: str, simulated: bool) -> str:
    """Title in one form: what is shown, on which data, and that it is simulated where it is."""
    origin = name_and_kind(data, simulated) if data else "simulated" * simulated
    lines = [*wrap(what, _TITLE_CHARACTERS), *wrap(origin, _TITLE_CHARACTERS)]
    return "\n".join(lines)
