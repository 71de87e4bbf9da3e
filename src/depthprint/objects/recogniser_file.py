"""The file of a trained recogniser: its encoder and what it keeps of the views, in one .npz without pickle."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoder_file import model_of_parts, model_parts
from depthprint.encoding import Encoding
from depthprint.errors import DepthprintError, ModelError
from depthprint.io.archive import DAMAGED, read_archive, write_archive
from depthprint.objects.calibration import Calibration
from depthprint.objects.kernels import DistanceFeatures
from depthprint.objects.leading_directions import LeadingDirections
from depthprint.objects.learned_classes import LearnedClasses
from depthprint.objects.stored_geometry import StoredGeometry
from depthprint.objects.stored_views import StoredViews
from depthprint.objects.surface_words import SurfaceWords
from depthprint.objects.view_features import ViewFeatures
from depthprint.signature import SignatureBatch

__all__ = ["FORMAT", "FORMAT_VERSION", "RecogniserParts", "load_recogniser", "save_recogniser"]

FORMAT = "depthprint recogniser"
FORMAT_VERSION = 8

SURFACE_ARRAYS = (
    "surface",
    "mirrored_surface",
    "pairs",
    "partial",
    "mirrored_partial",
    "partial_pairs",
)
DIRECTIONS = ("surface_directions", "pair_directions")

Arrays = dict[str, npt.NDArray[Any]]


class RecogniserParts(NamedTuple):
    """What a recogniser is made of: labels and sources (n,) are those of the stored views."""

    encoder: Encoder
    stored: StoredViews
    labels: Sequence[str]
    sources: Sequence[str]
    calibration: Calibration
    learned: LearnedClasses


def save_recogniser(parts: RecogniserParts, path: Path) -> Path:
    """Write a recogniser; .npz is added to a path without it."""
    if path.suffix != ".npz":
        path = path.with_name(path.name + ".npz")
    encoder, stored = parts.encoder, parts.stored
    model, arrays = model_parts(encoder.settings, encoder.streams)
    header = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "model": model,
        "labels": list(parts.labels),
        "sources": list(parts.sources),
        "temperature": parts.calibration.temperature,
        "novelty": parts.calibration.novelty,
        "distance_scale": stored.distance_features.scale,
        "surface_gammas": None,
    }
    arrays["directions"] = stored.directions.upper_bits
    arrays["landmark_basis"] = stored.distance_features.basis
    for kind in ("straight", "mirrored", "landmark"):
        arrays[kind] = getattr(stored.views, kind)
    if stored.words is not None:
        header["surface_gammas"], words = stored.words.parts()
        arrays |= {f"surface_words_{kind}": array for kind, array in words.items()}
        for name in DIRECTIONS:
            arrays[name] = getattr(stored, name).upper_bits
        for kind in SURFACE_ARRAYS:
            arrays[kind] = np.asarray(getattr(stored.views, kind))
    arrays |= parts.learned.parts()
    if stored.geometry is not None:
        arrays |= stored.geometry.parts()
    for number in range(len(encoder.settings.streams)):
        batch = SignatureBatch.stack([e.signatures[number] for e in stored.landmarks])
        arrays |= {
            f"weights_{number}": batch.weights,
            f"points_{number}": batch.points,
            f"counts_{number}": batch.counts,
        }
    write_archive(path, header, arrays)
    return path


def load_recogniser(path: Path) -> RecogniserParts:
    """Read what ``save_recogniser`` wrote; anything else raises ModelError naming the file and what is wrong."""
    header, arrays = read_archive(path, "recogniser (of 'depthprint train-objects')", FORMAT, FORMAT_VERSION)
    try:
        encoder = Encoder(*model_of_parts(header["model"], arrays, path))
        stored = StoredViews(
            directions=LeadingDirections(arrays["directions"]),
            landmarks=_landmarks(encoder, arrays),
            distance_features=DistanceFeatures.restored(
                float(header["distance_scale"]), arrays["landmark_basis"]
            ),
            views=ViewFeatures(
                arrays["straight"],
                arrays["mirrored"],
                arrays["landmark"],
                *(arrays.get(kind) for kind in SURFACE_ARRAYS),
            ),
            words=_surface_words(header["surface_gammas"], arrays),
            **{name: LeadingDirections(arrays[name]) for name in DIRECTIONS if name in arrays},
            geometry=None if header["surface_gammas"] is None else StoredGeometry.of_parts(arrays),
        )
        novelty = None if header["novelty"] is None else tuple(float(v) for v in header["novelty"])
        calibration = Calibration(float(header["temperature"]), novelty)
        return RecogniserParts(
            encoder,
            stored,
            header["labels"],
            header["sources"],
            calibration,
            LearnedClasses.of_parts(arrays, header["labels"]),
        )
    except ModelError:
        raise
    except (*DAMAGED, DepthprintError) as error:
        raise ModelError(f"{path}: expected a whole recogniser file, got {error}") from error


def _surface_words(gammas: dict[str, float] | None, arrays: Arrays) -> SurfaceWords | None:
    if gammas is None:
        return None
    return SurfaceWords.of_parts(gammas, {kind: arrays[f"surface_words_{kind}"] for kind in gammas})


def _landmarks(encoder: Encoder, arrays: Arrays) -> tuple[Encoding, ...]:
    batches = [
        SignatureBatch(
            arrays[f"weights_{n}"], arrays[f"points_{n}"], arrays[f"counts_{n}"], encoder.fingerprint
        )
        for n in range(len(encoder.settings.streams))
    ]
    return tuple(Encoding(tuple(batch[k] for batch in batches), ()) for k in range(len(batches[0])))
