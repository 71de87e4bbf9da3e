"""Distances between the views of objects: ours and the baselines, each a full matrix."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from depthprint.baselines.compression import CompressionRecognizer
from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.range_image import RangeImage
from depthprint.signature import Signature, SignatureBatch

__all__ = [
    "complexity_distances",
    "compression_distances",
    "cosine_distances",
    "pixel_distances",
]

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[int, int], None]


def complexity_distances(
    encoder: Encoder, queries: Sequence[Encoding], others: Sequence[Encoding] | None = None
) -> FloatArray:
    """Normalised information distances, (n, m) or symmetric (n, n): the streams' weighted sum.

    Where the preset mirrors views, the smaller of the distances to a view and to its mirror image.
    """
    straight = _stream_sum(
        encoder,
        [q.signatures for q in queries],
        None if others is None else [o.signatures for o in others],
    )
    if not encoder.settings.mirror:
        return straight
    targets = queries if others is None else others
    mirrored = [q.mirrored.signatures for q in queries if q.mirrored is not None]
    flipped = _stream_sum(encoder, mirrored, [t.signatures for t in targets])
    if others is None:
        flipped = np.minimum(flipped, flipped.T)
    return np.minimum(straight, flipped)


def _stream_sum(
    encoder: Encoder,
    queries: Sequence[Sequence[Signature]],
    others: Sequence[Sequence[Signature]] | None,
) -> FloatArray:
    from depthprint.emd import difference_matrix
    from depthprint.encoding import ground_distance

    shifts = encoder.shifts()
    total: FloatArray | float = 0.0
    for number, stream in enumerate(encoder.settings.streams):
        first = SignatureBatch.stack([q[number] for q in queries])
        second = None if others is None else SignatureBatch.stack([o[number] for o in others])
        matrix = difference_matrix(
            first,
            second,
            masses=stream.masses,
            ground=ground_distance(stream, encoder.settings),
            form=stream.form,
            shifts=None if shifts is None else shifts[number],
        )
        total = total + encoder.settings.stream_weights[number] * matrix
    return np.asarray(total, dtype=np.float64)


def cosine_distances(encoder: Encoder, queries: Sequence[Encoding]) -> FloatArray:
    """One minus the weighted mean cosine of the streams' pooled codes; the nearer of a view and its mirror image."""
    weights = encoder.settings.stream_weights
    total = np.zeros((len(queries), len(queries)))
    flipped = np.zeros_like(total)
    for number, weight in enumerate(weights):
        straight = _unit_rows([q.vectors[number] for q in queries])
        total += weight * (straight @ straight.T)
        if encoder.settings.mirror:
            mirrored = _unit_rows([q.mirrored.vectors[number] for q in queries if q.mirrored is not None])
            flipped += weight * (mirrored @ straight.T)
    if encoder.settings.mirror:
        total = np.maximum(total, np.maximum(flipped, flipped.T))
    return np.maximum(1.0 - total, 0.0)


def _unit_rows(grids: Sequence[npt.NDArray[np.float32]]) -> npt.NDArray[np.float32]:
    rows = np.stack([g.reshape(-1) for g in grids])
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9))


def pixel_distances(images: Sequence[RangeImage], size: int = 48) -> FloatArray:
    """Root mean square difference of relative depth in the object's frame, empty outside the mask."""
    from depthprint.settings import EncoderSettings, StreamSettings
    from depthprint.views import make_view

    stream = StreamSettings(view="depth", size=2 * size)
    settings = EncoderSettings(name="pixel", streams=(stream,))
    rows = np.stack([make_view(image, stream, settings).channels.reshape(-1) for image in images]).astype(
        np.float64
    )
    squares = (rows**2).sum(1)
    squared = squares[:, None] + squares[None] - 2.0 * rows @ rows.T
    return np.asarray(np.sqrt(np.maximum(squared, 0.0) / rows.shape[1]))


def compression_distances(
    images: Sequence[RangeImage], compressor: str, progress: Progress | None = None, workers: int = 2
) -> FloatArray:
    """Eq. 8 with a real compressor, for every pair (i < j, mirrored)."""
    recognizer = CompressionRecognizer(compressor, workers=workers)
    places = [recognizer.describe(image) for image in images]
    matrix = np.zeros((len(places), len(places)))
    for i, place in enumerate(places):
        matrix[i, i + 1 :] = recognizer.distances(place, places[i + 1 :])
        if progress is not None:
            progress(i + 1, len(places))
    return np.maximum(matrix, matrix.T)
