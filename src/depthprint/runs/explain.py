"""Why two depth images are near or far: the distance, taken apart."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from depthprint.runs.depth_files import read_view
from depthprint.runs.models import require_model

__all__ = ["ExplainedStream", "Explanation", "run_explain"]


@dataclass(frozen=True)
class ExplainedStream:
    """One stream's part: its normalised distance and weight, the EMD, and the complexities of both images."""

    name: str
    distance: float
    weight: float
    emd: float
    complexity_first: float
    complexity_second: float


@dataclass(frozen=True)
class Explanation:
    """The combined distance, its streams, and the figure of the flow of the first stream."""

    distance: float
    streams: tuple[ExplainedStream, ...]
    figure: Path


def run_explain(
    first: Path, second: Path, out: Path, *, preset: str | None = None, model: Path | None = None
) -> Explanation:
    """Compare two depth images stream by stream, at the shift at which they are nearest, and draw the flow.

    The distance is the streams' weighted mean. Raises DataError naming a file that cannot be used, ModelError for a
    model that does not fit.
    """
    from depthprint.complexity import emd_complexity
    from depthprint.emd import emd
    from depthprint.encoding import ground_distance
    from depthprint.ncd import FORMS
    from depthprint.runs.loop_figures import draw_pair_flow

    images = read_view(first), read_view(second)
    suited = "object" if images[0].mask is not None else "handheld"
    encoder = require_model(model, preset, suited)
    a, b = (encoder.describe(image) for image in images)
    index = encoder.make_index()
    index.add(b.signatures)
    [(_, distance, shift)] = index.query(a.signatures, k=1)
    shifts = encoder.shifts()
    streams = []
    for number, stream in enumerate(encoder.settings.streams):
        p, q = a.signatures[number], b.signatures[number]
        ground = ground_distance(stream, encoder.settings)
        offset = None if shifts is None else shifts[number][shift]
        moved = emd(p, q, masses=stream.masses, ground=ground, shift=offset).value
        complexities = tuple(emd_complexity(s, ground, masses=stream.masses) for s in (p, q))
        streams.append(
            ExplainedStream(
                name=f"{stream.view} {'+'.join(stream.channels)}".strip(),
                distance=float(FORMS[stream.form](moved, *complexities)),
                weight=encoder.settings.stream_weights[number],
                emd=float(moved),
                complexity_first=float(complexities[0]),
                complexity_second=float(complexities[1]),
            )
        )
    figure = draw_pair_flow(encoder, images, (a, b), out, titles=(first.name, second.name))
    return Explanation(float(distance), tuple(streams), figure)
