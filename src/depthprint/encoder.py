"""Encoder: RangeImage -> signatures. The trained model: fitted, saved, loaded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint.encoding import (
    Encoding,
    StreamModel,
    cluster_vectors,
    cluster_views,
    code_patches,
    ground_distance,
    make_signature,
    model_fingerprint,
)
from depthprint.errors import DataError, ModelError
from depthprint.patches import Patches, extract_patches
from depthprint.polar_view import turn_of_shift
from depthprint.presets import preset_settings
from depthprint.range_image import RangeImage
from depthprint.settings import EncoderSettings
from depthprint.signature import Signature
from depthprint.sparse_coding import SparseModel
from depthprint.views import View, make_view, make_views, mirrored_view

if TYPE_CHECKING:
    from depthprint.signature_index import SignatureIndex

__all__ = ["Encoder", "load_shipped_encoder"]

Progress = Callable[[int, int], None]
FloatArray = npt.NDArray[np.float64]


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
            self._fingerprint = model_fingerprint(self.settings, self.streams)
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
        straight: list[tuple[Signature, npt.NDArray[np.float32]]] = []
        mirrored: list[tuple[Signature, npt.NDArray[np.float32]]] = []
        views = make_views(image, self.settings)
        for view, settings, model in zip(views, self.settings.streams, self.streams, strict=True):
            turned = mirrored_view(view, settings) if self.settings.mirror else view
            # What is the same in the mirror is coded once.
            distinct = [view] if turned is view else [view, turned]
            found = [
                (
                    make_signature(clusters, settings, model.basis, self.fingerprint),
                    cluster_vectors(clusters, settings, model.basis),
                )
                for clusters in cluster_views(distinct, settings, self.settings, model.dictionary)
            ]
            straight.append(found[0])
            mirrored.append(found[-1])
        return _encoding(straight, _encoding(mirrored) if self.settings.mirror else None)

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
        return view, patches, code_patches(patches, model.dictionary, settings)

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

    def yaw_of_shift(self, shift: float | None) -> float:
        """Turn of T_match_query about 'up', radians, that a match's shift stands for; 0 but for a full circle."""
        polar = self.settings.polar
        if shift is None or not polar.full_circle or self.settings.streams[0].view != "polar":
            return 0.0
        return turn_of_shift(shift, polar.sectors)

    def save(self, path: Path | str) -> Path:
        """Write the model to one file, without pickle; the file appears whole or not at all."""
        from depthprint.encoder_file import save_model

        self._require_fitted()
        return save_model(self.settings, self.streams, Path(path))

    @classmethod
    def load(cls, path: Path | str) -> Encoder:
        """Read a model; a damaged file, or one of another version, raises ModelError naming it."""
        from depthprint.encoder_file import load_model

        return cls(*load_model(Path(path)))

    def _require_fitted(self) -> None:
        if not self.fitted:
            raise ModelError(f"encoder {self.settings.name!r}: not fitted; call fit() or load a model")


def _encoding(
    streams: Sequence[tuple[Signature, npt.NDArray[np.float32]]], mirrored: Encoding | None = None
) -> Encoding:
    return Encoding(
        tuple(signature for signature, _ in streams), tuple(rows for _, rows in streams), mirrored
    )


def load_shipped_encoder(preset: str) -> Encoder:
    """Load the encoder, trained on simulated worlds, that ships for a preset; ModelError where none does."""
    from depthprint.encoder_file import shipped_model_path

    return Encoder.load(shipped_model_path(preset))
