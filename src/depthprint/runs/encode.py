"""Encode a recording and write its signatures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from depthprint.runs.models import require_model
from depthprint.runs.source import DataSource
from depthprint.runs.stages import Stages, silent
from depthprint.signature import SignatureBatch

if TYPE_CHECKING:
    from depthprint.encoding import Encoding

__all__ = ["SIGNATURES_FORMAT", "EncodedSequence", "run_encode"]

SIGNATURES_FORMAT = "depthprint-signatures"
SIGNATURES_VERSION = 1


@dataclass(frozen=True)
class EncodedSequence:
    """Where the signatures are, and what they are of."""

    path: Path
    data: str
    n_images: int
    streams: tuple[str, ...]
    fingerprint: str


def run_encode(
    source: DataSource,
    out: Path,
    *,
    preset: str | None = None,
    model: Path | None = None,
    stages: Stages = silent,
) -> EncodedSequence:
    """Write the signatures of every frame to one .npz file without pickle.

    For stream s the arrays ``weights_s`` (n, k), ``points_s`` (n, k, d) and ``counts_s`` (n,), padded with zeros;
    ``header`` holds JSON: format, version, data, preset, fingerprint, names of the streams.
    """
    from depthprint.io.archive import write_archive

    sequence = source.open(stages("make the world"))
    encoder = require_model(model, preset, sequence.preset)
    encodings: list[Encoding] = []
    progress = stages("encode")
    for index in range(len(sequence)):
        encodings.append(encoder.describe(sequence[index]))
        progress(index + 1, len(sequence))
    streams = tuple(f"{s.view} {'+'.join(s.channels)}".strip() for s in encoder.settings.streams)
    header = {
        "format": SIGNATURES_FORMAT,
        "version": SIGNATURES_VERSION,
        "data": sequence.name,
        "simulated": sequence.simulated,
        "preset": encoder.settings.name,
        "fingerprint": encoder.fingerprint,
        "streams": list(streams),
        "images": len(encodings),
    }
    path = out if out.suffix == ".npz" else out.with_name(out.name + ".npz")
    write_archive(path, header, _arrays(encodings, len(streams)))
    return EncodedSequence(path, sequence.name, len(encodings), streams, encoder.fingerprint)


def _arrays(encodings: Sequence[Encoding], n_streams: int) -> dict[str, npt.NDArray[Any]]:
    arrays: dict[str, npt.NDArray[Any]] = {}
    for stream in range(n_streams):
        batch = SignatureBatch.stack([encoding.signatures[stream] for encoding in encodings])
        arrays[f"weights_{stream}"] = batch.weights
        arrays[f"points_{stream}"] = batch.points
        arrays[f"counts_{stream}"] = batch.counts
    return arrays
