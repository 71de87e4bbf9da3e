"""What is installed, and what a file of ours holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from depthprint.encoder_file import FORMAT
from depthprint.errors import ModelError
from depthprint.io.archive import read_header
from depthprint.runs.encode import SIGNATURES_FORMAT

__all__ = ["describe_file", "describe_installation"]


def describe_installation() -> dict[str, str]:
    """Versions of depthprint and what computes for it, and the names of presets, data sets and methods."""
    from depthprint.datasets.registry import OBJECT_SETS, SEQUENCES
    from depthprint.objects.methods import OBJECT_METHODS
    from depthprint.place_methods import PLACE_METHODS
    from depthprint.presets import PRESETS
    from depthprint.run_folder import versions

    facts = versions()
    facts["presets"] = ", ".join(PRESETS)
    facts["data sets"] = ", ".join(sorted({*SEQUENCES, *OBJECT_SETS}))
    facts["methods for loops"] = ", ".join(PLACE_METHODS)
    facts["methods for objects"] = ", ".join(OBJECT_METHODS)
    return facts


def describe_file(path: Path) -> dict[str, str]:
    """Content of a model, dictionary or signature file; ModelError for a damaged or another file."""
    if not path.is_file():
        raise ModelError(f"{path}: no such file")
    header = read_header(path)
    if header["format"] == SIGNATURES_FORMAT:
        facts = {key: _text(value) for key, value in header.items() if key != "format"}
        return {"signatures": str(path), **facts}
    if header["format"] == FORMAT:
        return _describe_model(path)
    from depthprint.objects.recogniser_file import FORMAT as RECOGNISER_FORMAT

    if header["format"] == RECOGNISER_FORMAT:
        return _describe_recogniser(path)
    return _describe_dictionary(path)


def _describe_model(path: Path) -> dict[str, str]:
    from depthprint.encoder import Encoder

    encoder = Encoder.load(path)
    facts = {"model": str(path), "preset": encoder.settings.name, "fingerprint": encoder.fingerprint}
    for number, (stream, learned) in enumerate(zip(encoder.settings.streams, encoder.streams, strict=True)):
        atoms = learned.dictionary.atoms
        facts[f"stream {number}"] = (
            f"{stream.view} {'+'.join(stream.channels)}".strip()
            + f": {len(atoms)} {learned.dictionary.kind} atoms of {atoms.shape[1]} values, "
            + f"{stream.n_nonzero} by {stream.pursuit}, clusters '{stream.clusters}', weight {stream.weight:g}"
        )
    return facts


def _describe_recogniser(path: Path) -> dict[str, str]:
    from depthprint.objects.trained_recogniser import TrainedRecogniser

    recogniser = TrainedRecogniser.load(path)
    return {
        "recogniser": str(path),
        "preset": recogniser.encoder.settings.name,
        "classes": ", ".join(recogniser.labels),
        "views": str(len(recogniser.view_labels)),
    }


def _describe_dictionary(path: Path) -> dict[str, str]:
    from depthprint.dictionary import Dictionary

    dictionary = Dictionary.load(path)
    return {
        "dictionary": str(path),
        "kind": dictionary.kind,
        "atoms": f"{dictionary.atoms.shape[0]} of {dictionary.atoms.shape[1]} values",
        "seed": str(dictionary.seed),
        "fingerprint": dictionary.fingerprint,
        **{key: _text(value) for key, value in dictionary.settings.items()},
    }


def _text(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
