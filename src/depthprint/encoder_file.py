"""The model file: settings, dictionaries and bases in one .npz, without pickle, versioned and checked."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from depthprint.dictionary import Dictionary
from depthprint.errors import DepthprintError, ModelError
from depthprint.io.atomic import atomic_path
from depthprint.settings import EncoderSettings

if TYPE_CHECKING:
    from depthprint.encoder import Encoder

__all__ = ["FORMAT_VERSION", "load_encoder", "save_encoder", "shipped_model_path"]

FORMAT = "depthprint-encoder"
FORMAT_VERSION = 1


def shipped_model_path(preset: str) -> Path:
    """Path of the model, trained on simulated worlds, that the package ships for a preset."""
    path = Path(__file__).parent / "models" / f"{preset}.npz"
    if not path.is_file():
        raise ModelError(f"no model ships for preset {preset!r}; train one with 'depthprint train'")
    return path


def save_encoder(encoder: Encoder, path: Path) -> Path:
    """Write a fitted encoder; .npz is added to a path without suffix."""
    if path.suffix != ".npz":
        path = path.with_name(path.name + ".npz")
    header = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "settings": encoder.settings.model_dump(mode="json"),
        "fingerprint": encoder.fingerprint,
        "dictionaries": [
            {"kind": s.dictionary.kind, "settings": dict(s.dictionary.settings), "seed": s.dictionary.seed}
            for s in encoder.streams
        ],
    }
    arrays: dict[str, Any] = {"header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)}
    for number, stream in enumerate(encoder.streams):
        arrays[f"atoms_{number}"] = stream.dictionary.atoms.astype(np.float32)
        arrays[f"basis_{number}"] = stream.basis.astype(np.float32)
    with atomic_path(path) as temporary, open(temporary, "wb") as stream_out:
        np.savez_compressed(stream_out, **arrays)
    return path


def load_encoder(path: Path) -> Encoder:
    """Read what ``save_encoder`` wrote; anything else raises ModelError naming the file and what is wrong."""
    from depthprint.encoder import Encoder, StreamModel

    if not path.is_file():
        raise ModelError(f"{path}: no such model file")
    try:
        with np.load(path, allow_pickle=False) as archive:
            header = json.loads(bytes(archive["header"]).decode())
            arrays = {name: archive[name] for name in archive.files if name != "header"}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, UnicodeDecodeError) as error:
        raise ModelError(f"{path}: expected a depthprint model (.npz), found a damaged or other file ({error})") from None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ModelError(f"{path}: expected a depthprint model, found format {_format_of(header)!r}")
    if header.get("version") != FORMAT_VERSION:
        raise ModelError(
            f"{path}: expected model version {FORMAT_VERSION}, found {header.get('version')!r}; train it again"
        )
    try:
        settings = EncoderSettings.parse(header["settings"])
        streams = tuple(
            StreamModel(
                Dictionary(_unit_rows(arrays[f"atoms_{number}"]), kind["kind"], kind["settings"], kind["seed"]),
                np.asarray(arrays[f"basis_{number}"], dtype=np.float64),
            )
            for number, kind in enumerate(header["dictionaries"])
        )
    except (KeyError, TypeError, DepthprintError) as error:
        raise ModelError(f"{path}: damaged model: {error}") from None
    if len(streams) != len(settings.streams):
        raise ModelError(f"{path}: expected {len(settings.streams)} dictionaries, found {len(streams)}")
    return Encoder(settings, streams)


def _unit_rows(atoms: Any) -> Any:
    rows = np.asarray(atoms, dtype=np.float64)
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def _format_of(header: object) -> object:
    return header.get("format") if isinstance(header, dict) else type(header).__name__
