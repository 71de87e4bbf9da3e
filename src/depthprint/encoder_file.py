"""The model file: settings, dictionaries and bases in one .npz, without pickle, versioned and checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.dictionary import Dictionary
from depthprint.encoding import StreamModel, model_fingerprint
from depthprint.errors import DepthprintError, ModelError
from depthprint.io.archive import DAMAGED, read_archive, write_archive
from depthprint.settings import EncoderSettings

__all__ = [
    "FORMAT",
    "FORMAT_VERSION",
    "load_model",
    "model_of_parts",
    "model_parts",
    "pack_atoms",
    "save_model",
    "shipped_model_path",
    "unpack_atoms",
]

FORMAT = "depthprint model"
FORMAT_VERSION = 1

FloatArray = npt.NDArray[np.float64]


def shipped_model_path(preset: str) -> Path:
    """Path of the model, trained on simulated worlds, that the package ships for a preset."""
    path = Path(__file__).parent / "models" / f"{preset}.npz"
    if not path.is_file():
        raise ModelError(f"no model ships for preset {preset!r}; train one with 'depthprint train'")
    return path


def save_model(settings: EncoderSettings, streams: Sequence[StreamModel], path: Path) -> Path:
    """Write settings and what was learned; .npz is added to a path without it."""
    if path.suffix != ".npz":
        path = path.with_name(path.name + ".npz")
    header, arrays = model_parts(settings, streams)
    write_archive(path, {"format": FORMAT, "version": FORMAT_VERSION, **header}, arrays)
    return path


def load_model(path: Path) -> tuple[EncoderSettings, tuple[StreamModel, ...]]:
    """Read what ``save_model`` wrote; anything else raises ModelError naming the file and what is wrong."""
    header, arrays = read_archive(path, "depthprint model", FORMAT, FORMAT_VERSION)
    return model_of_parts(header, arrays, path)


def model_parts(
    settings: EncoderSettings, streams: Sequence[StreamModel]
) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """What a file holds of an encoder: entries of its header, and arrays."""
    header = {
        "settings": settings.model_dump(mode="json"),
        "fingerprint": model_fingerprint(settings, streams),
        "dictionaries": [
            {"kind": s.dictionary.kind, "settings": dict(s.dictionary.settings), "seed": s.dictionary.seed}
            for s in streams
        ],
    }
    arrays: dict[str, npt.NDArray[Any]] = {}
    for number, stream in enumerate(streams):
        arrays[f"atoms_{number}"] = pack_atoms(stream.dictionary.atoms)
        arrays[f"basis_{number}"] = stream.basis.astype(np.float32)
    return header, arrays


def model_of_parts(
    header: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]], path: Path
) -> tuple[EncoderSettings, tuple[StreamModel, ...]]:
    """The encoder that ``model_parts`` took apart; ModelError naming the file where something does not fit."""
    try:
        settings = EncoderSettings.parse(header["settings"])
        streams = tuple(
            StreamModel(
                Dictionary(
                    unpack_atoms(arrays[f"atoms_{number}"]), made["kind"], made["settings"], made["seed"]
                ),
                np.asarray(arrays[f"basis_{number}"], dtype=np.float64),
            )
            for number, made in enumerate(header["dictionaries"])
        )
        expected = header["fingerprint"]
    except (*DAMAGED, DepthprintError) as error:
        raise ModelError(f"{path}: expected a whole model file, got {error}") from error
    found = model_fingerprint(settings, streams)
    if len(streams) != len(settings.streams) or found != expected:
        raise ModelError(
            f"{path}: expected a model of fingerprint {expected}, got {found}; the file was altered"
        )
    return settings, streams


def pack_atoms(atoms: FloatArray) -> npt.NDArray[np.int8]:
    """Atoms in 8 bits, each scaled to its largest entry: (n, d) int8."""
    largest = np.abs(atoms).max(axis=1, keepdims=True)
    return np.asarray(np.round(atoms / largest * 127), dtype=np.int8)


def unpack_atoms(packed: npt.NDArray[np.int8]) -> FloatArray:
    """Unit atoms of their 8-bit form. What ``fit`` keeps has been through both, so that a saved model is the same."""
    rows = packed.astype(np.float64)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))
