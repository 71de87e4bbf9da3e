"""What an encoder learns: dictionaries from patches, and the principal directions of clusters."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from depthprint.clusters import make_clusters
from depthprint.dictionary import Dictionary
from depthprint.dictionary_learning import learn_dictionary, random_patches_dictionary
from depthprint.encoder_file import pack_atoms, unpack_atoms
from depthprint.encoding import StreamModel, code_patches
from depthprint.errors import DataError
from depthprint.parametric_dictionary import parametric_dictionary
from depthprint.patches import Patches, extract_patches
from depthprint.range_image import RangeImage
from depthprint.settings import EncoderSettings, StreamSettings
from depthprint.views import make_view

__all__ = ["fit_stream"]

FloatArray = npt.NDArray[np.float64]

_MAX_TRAINING_PATCHES = 20_000
_MAX_BASIS_CLUSTERS = 20_000


def fit_stream(
    images: Sequence[RangeImage],
    stream: StreamSettings,
    settings: EncoderSettings,
    report: Callable[[int], None],
) -> StreamModel:
    """Learn one stream: a dictionary of its patches, then the basis of its clusters."""
    patches = _training_patches(images, stream, settings, report)
    rng = np.random.default_rng(settings.seed)
    learned = _learn(patches, stream, settings, rng)
    # As a model file holds it: a saved and loaded encoder gives the same signatures, bit for bit.
    dictionary = Dictionary(
        unpack_atoms(pack_atoms(learned.atoms)), learned.kind, learned.settings, learned.seed
    )
    basis = _cluster_basis(patches, dictionary, stream, rng).astype(np.float32).astype(np.float64)
    return StreamModel(dictionary, basis)


def _training_patches(
    images: Sequence[RangeImage],
    stream: StreamSettings,
    settings: EncoderSettings,
    report: Callable[[int], None],
) -> list[Patches]:
    wraps = settings.polar.full_circle and stream.view == "polar"
    patches = []
    for number in range(len(images)):
        patches.append(extract_patches(make_view(images[number], stream, settings), stream, wraps))
        report(number + 1)
    return patches


def _learn(
    patches: Sequence[Patches], stream: StreamSettings, settings: EncoderSettings, rng: np.random.Generator
) -> Dictionary:
    signals = np.concatenate([p.vectors for p in patches])
    if stream.dictionary == "pixels":
        return Dictionary(np.eye(signals.shape[1]), "pixels")
    norms = np.linalg.norm(signals, axis=1)
    known = np.flatnonzero(norms > 1e-6 * max(float(norms.max(initial=0.0)), 1e-12))
    if len(known) < stream.n_atoms and stream.dictionary != "parametric":
        raise DataError(
            f"training: {stream.n_atoms} atoms need at least as many patches with returns, got {len(known)} "
            f"from {len(patches)} images"
        )
    chosen = np.sort(rng.permutation(known)[:_MAX_TRAINING_PATCHES])
    signals = signals[chosen].astype(np.float64)
    if stream.dictionary == "random":
        return random_patches_dictionary(signals, stream.n_atoms, seed=settings.seed)
    if stream.dictionary == "parametric":
        shape = _single_channel_shape(patches[0], stream)
        return parametric_dictionary(shape, stream.n_atoms, seed=settings.seed)
    penalty = "omp" if stream.dictionary == "omp" else "l1"
    signals /= np.linalg.norm(signals, axis=1, keepdims=True)
    return learn_dictionary(
        signals, stream.n_atoms, penalty=penalty, n_nonzero=stream.n_nonzero, seed=settings.seed
    )


def _single_channel_shape(patches: Patches, stream: StreamSettings) -> tuple[int, int]:
    size = patches.vectors.shape[1]
    side = round(size**0.5)
    shape = (side, side) if stream.atoms == "image" else stream.patch_shape
    if shape[0] * shape[1] != size:
        raise DataError(f"parametric dictionary: needs single-channel square patches, got vectors of {size}")
    return shape


def _cluster_basis(
    patches: Sequence[Patches], dictionary: Dictionary, stream: StreamSettings, rng: np.random.Generator
) -> FloatArray:
    """Columns that bring cluster appearances to the ground space, the leading ``point_dims`` of them (0: all).

    For picked atoms the rows are coordinates with the atoms' own inner products, so that distances between signed
    atoms are kept exactly; else the columns are the leading right singular vectors of normalised clusters.
    """
    if stream.clusters == "atoms":
        values, vectors = np.linalg.eigh(dictionary.gram_as(np.float64))
        basis = vectors * np.sqrt(np.maximum(values, 0.0))
    else:
        directions = _cluster_directions(patches, dictionary, stream, rng)
        _, basis = np.linalg.eigh(directions.T @ directions)
    basis = basis[:, ::-1]
    if stream.point_dims:
        basis = basis[:, : stream.point_dims]
    signs = np.where(basis[np.abs(basis).argmax(0), np.arange(basis.shape[1])] < 0, -1.0, 1.0)
    return np.ascontiguousarray(basis * signs)


def _cluster_directions(
    patches: Sequence[Patches], dictionary: Dictionary, stream: StreamSettings, rng: np.random.Generator
) -> FloatArray:
    """Normalised clusters of images drawn at random, (n, a)."""
    rows: list[FloatArray] = []
    count = 0
    for number in rng.permutation(len(patches)):
        model = code_patches(patches[number], dictionary, stream)
        clusters = make_clusters(model, patches[number], dictionary.atoms, stream)
        rows.append(clusters.appearance)
        count += len(clusters.appearance)
        if count >= _MAX_BASIS_CLUSTERS:
            break
    stacked = np.concatenate(rows)
    norms = np.linalg.norm(stacked, axis=1)
    return np.asarray(stacked[norms > 1e-9] / norms[norms > 1e-9, None])
