"""Encoder: RangeImage -> signatures. The trained model: fitted, saved, loaded."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint.clusters import Clusters, make_clusters
from depthprint.dictionary import Dictionary
from depthprint.errors import DataError, ModelError
from depthprint.patches import Patches, extract_patches
from depthprint.presets import preset_settings
from depthprint.range_image import RangeImage
from depthprint.settings import EncoderSettings, StreamSettings
from depthprint.signature import GroundDistance, Signature
from depthprint.sparse_coding import SparseModel, sparse_code
from depthprint.views import View, make_view

if TYPE_CHECKING:
    from depthprint.signature_index import SignatureIndex

__all__ = ["Encoder", "Encoding", "StreamModel"]

Progress = Callable[[int, int], None]
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class StreamModel:
    """What one stream learned: its dictionary and the principal directions of its clusters.

    basis: (a, point_dims) float64, orthonormal columns; appearance @ basis gives ground coordinates.
    """

    dictionary: Dictionary
    basis: FloatArray


@dataclass(frozen=True)
class Encoding:
    """One image, encoded.

    signatures: one a stream. vectors: one a stream, (m, a) float32, the unnormalised cluster appearances on the whole
    grid (the pooled codes that a plain vector distance compares). mirrored: the encoding of the mirrored view, where
    the preset asks for it.
    """

    signatures: tuple[Signature, ...]
    vectors: tuple[npt.NDArray[np.float32], ...]
    mirrored: Encoding | None = None


class Encoder:
    """Encode range images by the method of the paper, in the configuration of a preset.

    >>> encoder = Encoder.from_preset("street").fit(images)       # doctest: +SKIP
    >>> encoding = encoder.describe(images[0])                     # doctest: +SKIP
    """

    def __init__(self, settings: EncoderSettings, streams: tuple[StreamModel, ...] = ()) -> None:
        self.settings = settings
        self.streams = streams
        self._fingerprint = ""

    @classmethod
    def from_preset(cls, name: str, *, seed: int = 0) -> Encoder:
        """Make an encoder that is still to be fitted."""
        return cls(preset_settings(name).model_copy(update={"seed": seed}))

    @property
    def fitted(self) -> bool:
        """Whether dictionaries are there."""
        return len(self.streams) == len(self.settings.streams)

    @property
    def fingerprint(self) -> str:
        """Short hash of settings and everything learned: equal fingerprints make comparable signatures."""
        if not self._fingerprint:
            digest = hashlib.sha256(self.settings.model_dump_json().encode())
            for stream in self.streams:
                digest.update(stream.dictionary.fingerprint.encode())
                digest.update(np.ascontiguousarray(stream.basis).tobytes())
            self._fingerprint = digest.hexdigest()[:16]
        return self._fingerprint

    def fit(self, images: Sequence[RangeImage], progress: Progress | None = None) -> Encoder:
        """Learn dictionaries (eq. 1-2) and cluster bases from range images; labels are not needed.

        Raises DataError when there are too few images or patches to learn from. Deterministic for a seed.
        """
        from depthprint.encoder_fitting import fit_stream

        if len(images) < 2:
            raise DataError(f"training: expected at least 2 range images, got {len(images)}")
        steps = len(self.settings.streams) * len(images)
        models = []
        for number, stream in enumerate(self.settings.streams):

            def report(done: int, offset: int = number * len(images)) -> None:
                if progress is not None:
                    progress(offset + done, steps)

            models.append(fit_stream(images, stream, self.settings, report))
        self.streams = tuple(models)
        self._fingerprint = ""
        return self

    def describe(self, image: RangeImage) -> Encoding:
        """Encode one image. Raises ModelError when not fitted, DataError (naming the frame) on bad input."""
        self._require_fitted()
        encoding = self._describe(image, mirror=False)
        if not self.settings.mirror:
            return encoding
        return Encoding(encoding.signatures, encoding.vectors, self._describe(image, mirror=True))

    def describe_many(self, images: Sequence[RangeImage], progress: Progress | None = None) -> list[Encoding]:
        """Encode images in order."""
        encodings = []
        for number in range(len(images)):
            encodings.append(self.describe(images[number]))
            if progress is not None:
                progress(number + 1, len(images))
        return encodings

    def codes(self, image: RangeImage, stream: int = 0) -> tuple[View, Patches, SparseModel]:
        """View, patches and sparse model of one stream, for figures and for compressors."""
        self._require_fitted()
        settings, model = self.settings.streams[stream], self.streams[stream]
        view = make_view(image, settings, self.settings)
        patches = extract_patches(
            view, settings, self.settings.polar.full_circle and settings.view == "polar"
        )
        return view, patches, _code(patches, model.dictionary, settings)

    def make_index(self) -> SignatureIndex:
        """Make an empty index under this encoder's distance."""
        from depthprint.signature_index import SignatureIndex, StreamDistance

        streams = [
            StreamDistance(ground_distance(s, self.settings), s.masses, s.form, weight)
            for s, weight in zip(self.settings.streams, self.settings.stream_weights, strict=True)
        ]
        return SignatureIndex(streams, shifts=self.shifts())

    def shifts(self) -> list[FloatArray] | None:
        """Position offsets that the shift search tries, (n_shifts, position_dims) for each stream, or None."""
        offsets = self.shift_offsets()
        if len(offsets) == 1:
            return None
        return [offsets * stream.position_weight for stream in self.settings.streams]

    def shift_offsets(self) -> FloatArray:
        """The shifts as shares of the view's extent, (n_shifts, 1) sideways or (n_shifts, 2) both ways, least first."""
        settings = self.settings
        if any(stream.view == "polar" for stream in settings.streams):
            return np.asarray(self.shift_sectors(), dtype=np.float64)[:, None] / settings.polar.sectors
        x, y = (np.arange(-steps, steps + 1) for steps in settings.view_shift_steps)
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return grid[np.argsort(np.abs(grid).sum(1), kind="stable")] * settings.view_shift

    def shift_sectors(self) -> list[int]:
        """The shifts of a bird's-eye view in sectors, least first; only 0 where there is none."""
        polar = self.settings.polar
        if polar.full_circle and any(s.view == "polar" for s in self.settings.streams):
            step = max(1, self.settings.streams[0].stride)
            return list(range(0, polar.sectors, step))
        return sorted(range(-self.settings.max_shift, self.settings.max_shift + 1), key=abs)

    def save(self, path: Path | str) -> Path:
        """Write the model to one file, without pickle; the file appears whole or not at all."""
        from depthprint.encoder_file import save_encoder

        self._require_fitted()
        return save_encoder(self, Path(path))

    @classmethod
    def load(cls, path: Path | str) -> Encoder:
        """Read a model; a damaged file, or one of another version, raises ModelError naming it."""
        from depthprint.encoder_file import load_encoder

        return load_encoder(Path(path))

    def _require_fitted(self) -> None:
        if not self.fitted:
            raise ModelError(f"encoder {self.settings.name!r}: not fitted; call fit() or load a model")

    def _describe(self, image: RangeImage, mirror: bool) -> Encoding:
        signatures, vectors = [], []
        for settings, model in zip(self.settings.streams, self.streams, strict=True):
            clusters = encode_clusters(image, settings, self.settings, model.dictionary, mirror)
            signatures.append(make_signature(clusters, settings, model.basis, self.fingerprint))
            vectors.append(_vectors(clusters, settings, model.basis))
        return Encoding(tuple(signatures), tuple(vectors))

    def describe_settings(self) -> str:
        """Settings as JSON text."""
        return json.dumps(self.settings.model_dump(mode="json"), indent=2)


def encode_clusters(
    image: RangeImage,
    stream: StreamSettings,
    settings: EncoderSettings,
    dictionary: Dictionary,
    mirror: bool = False,
) -> Clusters:
    """Range image -> view -> patches -> sparse model -> clusters."""
    view = make_view(image, stream, settings, mirror)
    patches = extract_patches(view, stream, settings.polar.full_circle and stream.view == "polar")
    model = _code(patches, dictionary, stream)
    return make_clusters(model, patches, dictionary.atoms, stream)


def make_signature(
    clusters: Clusters, stream: StreamSettings, basis: FloatArray, fingerprint: str
) -> Signature:
    """Project cluster appearances to the ground space; empty clusters are left out."""
    mass = np.linalg.norm(clusters.appearance, axis=1)
    kept = mass > 1e-9
    mass = mass[kept]
    direction = clusters.appearance[kept] @ basis
    norm = np.linalg.norm(direction, axis=1, keepdims=True)
    direction = np.divide(direction, norm, out=np.zeros_like(direction), where=norm > 1e-12)
    columns = [direction]
    if stream.depth_weight > 0:
        columns.append(stream.depth_weight * clusters.depth[kept, None])
    if stream.position_weight > 0:
        columns.append(stream.position_weight * clusters.positions[kept])
    weights = np.ones_like(mass) if stream.mass == "unit" else mass
    return Signature(weights, np.concatenate(columns, axis=1), fingerprint)


def _vectors(clusters: Clusters, stream: StreamSettings, basis: FloatArray) -> npt.NDArray[np.float32]:
    """Cluster appearances with the weights that the signature gives them."""
    rows = clusters.appearance if stream.clusters == "cells" else clusters.appearance @ basis
    if stream.mass == "unit":
        norms = np.linalg.norm(rows, axis=1, keepdims=True)
        rows = np.divide(rows, norms, out=np.zeros_like(rows), where=norms > 1e-9)
    return rows.astype(np.float32)


def ground_distance(stream: StreamSettings, settings: EncoderSettings) -> GroundDistance:
    """The stream's ground distance over its points' coordinates."""
    dims = 0
    if stream.position_weight > 0:
        dims = 1 if stream.view == "polar" and stream.patch_shape[0] == 0 else 2
    wraps = settings.polar.full_circle and stream.view == "polar" and dims > 0
    return GroundDistance(
        cap=stream.cap, position_dims=dims, period=stream.position_weight if wraps else None
    )


def _code(patches: Patches, dictionary: Dictionary, stream: StreamSettings) -> SparseModel:
    return sparse_code(patches.vectors, dictionary, algorithm=stream.pursuit, n_nonzero=stream.n_nonzero)
