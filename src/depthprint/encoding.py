"""From a range image to its signatures, one stream at a time: what an encoder does with what it learned."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from depthprint.clusters import Clusters, make_clusters
from depthprint.dictionary import Dictionary
from depthprint.patches import Patches, extract_patches
from depthprint.range_image import RangeImage
from depthprint.settings import EncoderSettings, StreamSettings
from depthprint.signature import GroundDistance, Signature
from depthprint.sparse_coding import SparseModel, sparse_code
from depthprint.views import View, make_view

__all__ = [
    "Encoding",
    "StreamModel",
    "cluster_vectors",
    "cluster_views",
    "code_patches",
    "encode_clusters",
    "ground_distance",
    "make_signature",
    "model_fingerprint",
]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class StreamModel:
    """What one stream learned: its dictionary and the principal directions of its clusters.

    basis: (a, point_dims) float64; appearance @ basis gives ground coordinates.
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


def model_fingerprint(settings: EncoderSettings, streams: Sequence[StreamModel]) -> str:
    """Short hash of settings and everything learned: equal fingerprints make comparable signatures."""
    digest = hashlib.sha256(settings.model_dump_json().encode())
    for stream in streams:
        digest.update(stream.dictionary.fingerprint.encode())
        digest.update(np.ascontiguousarray(stream.basis).tobytes())
    return digest.hexdigest()[:16]


def encode_clusters(
    image: RangeImage,
    stream: StreamSettings,
    settings: EncoderSettings,
    dictionary: Dictionary,
    mirror: bool = False,
) -> Clusters:
    """Range image -> view -> patches -> sparse model -> clusters."""
    return cluster_views([make_view(image, stream, settings, mirror)], stream, settings, dictionary)[0]


def cluster_views(
    views: Sequence[View], stream: StreamSettings, settings: EncoderSettings, dictionary: Dictionary
) -> list[Clusters]:
    """Clusters of a stream's views, whose patches are coded together."""
    wraps = settings.polar.full_circle and stream.view == "polar"
    patches = [extract_patches(view, stream, wraps) for view in views]
    if len(views) == 1:
        models = [code_patches(patches[0], dictionary, stream)]
    else:
        together = _code(np.concatenate([p.vectors for p in patches]), dictionary, stream)
        ends = np.cumsum([0, *(len(p.vectors) for p in patches)])
        models = [together.rows(*pair) for pair in pairwise(ends.tolist())]
    return [make_clusters(m, p, dictionary.atoms, stream) for m, p in zip(models, patches, strict=True)]


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


def cluster_vectors(clusters: Clusters, stream: StreamSettings, basis: FloatArray) -> npt.NDArray[np.float32]:
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
        dims = 1 if stream.patch_shape[0] == 0 else 2
    wraps = settings.polar.full_circle and stream.view == "polar" and dims > 0
    return GroundDistance(
        cap=stream.cap, position_dims=dims, period=stream.position_weight if wraps else None
    )


def code_patches(patches: Patches, dictionary: Dictionary, stream: StreamSettings) -> SparseModel:
    """Sparse models of patches, by the stream's pursuit; of pixels for atoms, the patches themselves."""
    return _code(patches.vectors, dictionary, stream)


def _code(vectors: npt.NDArray[np.float32], dictionary: Dictionary, stream: StreamSettings) -> SparseModel:
    if stream.dictionary == "pixels":
        return _all_pixels(vectors)
    busy = np.asarray(vectors.any(axis=1))
    coded = vectors if busy.all() else vectors[busy]
    model = sparse_code(coded, dictionary, algorithm=stream.pursuit, n_nonzero=stream.n_nonzero)
    return model if coded is vectors else model.spread(busy)


def _all_pixels(vectors: npt.NDArray[np.float32]) -> SparseModel:
    """What a pursuit over one atom a pixel comes to without a limit: all values that are not 0."""
    patch, pixel = np.nonzero(vectors)
    indptr = np.searchsorted(patch, np.arange(len(vectors) + 1))
    unexplained = np.zeros(len(vectors), dtype=vectors.dtype)
    return SparseModel(indptr, pixel.astype(np.int32), vectors[patch, pixel], unexplained, vectors.shape[1])
