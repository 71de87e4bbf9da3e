"""Distances between the views of objects: ours and the baselines, each a full matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
import numpy.typing as npt

from depthprint.baselines.compression import CompressionRecognizer
from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.range_image import RangeImage
from depthprint.signature import SignatureBatch

__all__ = [
    "MirroredDistances",
    "compare_codes",
    "compare_complexities",
    "compare_with_batches",
    "complexity_distances",
    "compression_distances",
    "cosine_distances",
    "pixel_distances",
    "relaxed_distances",
    "signature_batches",
    "stream_part",
    "sum_of_parts",
]

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class MirroredDistances:
    """Distances of views to views, (n, m) read-only, and of mirrored views to views where the preset mirrors."""

    straight: FloatArray
    mirrored: FloatArray | None = None

    def __post_init__(self) -> None:
        for array in (self.straight, self.mirrored):
            if array is not None:
                array.setflags(write=False)

    def nearer(self) -> FloatArray:
        """The smaller distance, to a view or to its mirror image."""
        return self.straight if self.mirrored is None else np.minimum(self.straight, self.mirrored)

    def gaussian_kernel(self, scale: float) -> FloatArray:
        """exp(-d^2 / scale), of a view and of its mirror image added up."""
        kernel = np.exp(-(self.straight**2) / scale)
        return kernel if self.mirrored is None else kernel + np.exp(-(self.mirrored**2) / scale)


def complexity_distances(
    encoder: Encoder, queries: Sequence[Encoding], others: Sequence[Encoding] | None = None
) -> FloatArray:
    """Normalised information distances, (n, m) or symmetric (n, n): the streams' weighted sum.

    Where the preset mirrors views, the smaller of the distances to a view and to its mirror image.
    """
    return compare_complexities(encoder, queries, others).nearer()


def compare_complexities(
    encoder: Encoder,
    queries: Sequence[Encoding],
    others: Sequence[Encoding] | None = None,
    progress: Progress | None = None,
) -> MirroredDistances:
    """Normalised information distances to views and to their mirror images, (n, m) or symmetric (n, n)."""
    if others is not None:
        return compare_with_batches(encoder, queries, signature_batches(others), progress)
    streams = range(len(encoder.settings.streams))
    found = sum_of_parts(stream_part(encoder, number, queries, None, progress) for number in streams)
    if found.mirrored is None:
        return found
    return MirroredDistances(found.straight, np.minimum(found.mirrored, found.mirrored.T))


def compare_with_batches(
    encoder: Encoder,
    queries: Sequence[Encoding],
    others: Sequence[SignatureBatch],
    progress: Progress | None = None,
) -> MirroredDistances:
    """``compare_complexities`` with other views, whose signatures ``signature_batches`` brought together before."""
    return sum_of_parts(
        stream_part(encoder, number, queries, batch, progress) for number, batch in enumerate(others)
    )


def stream_part(
    encoder: Encoder,
    number: int,
    queries: Sequence[Encoding],
    others: SignatureBatch | None,
    progress: Progress | None = None,
) -> MirroredDistances:
    """One stream's distances to other views' signatures, to the views' own where None, times the stream's share."""
    straight = [query.signatures[number] for query in queries]
    mirrored = [query.mirrored.signatures[number] for query in queries if query.mirrored is not None]
    # What is the same in the mirror is compared once.
    turned = mirrored if any(a is not b for a, b in zip(straight, mirrored, strict=False)) else []
    if others is None:
        own = SignatureBatch.stack(straight)
        near = _stream_matrix(encoder, number, own, None, progress)
        far = _stream_matrix(encoder, number, SignatureBatch.stack(turned), own, progress) if turned else near
    else:
        found = _stream_matrix(encoder, number, SignatureBatch.stack([*straight, *turned]), others, progress)
        near, far = found[: len(straight)], found[-len(straight) :]
    return MirroredDistances(near, far if mirrored else None)


def sum_of_parts(parts: Iterable[MirroredDistances]) -> MirroredDistances:
    """The distances that the streams' parts add up to; none is kept longer than it takes to add it."""
    return reduce(_added, parts)


def _added(first: MirroredDistances, second: MirroredDistances) -> MirroredDistances:
    straight = first.straight + second.straight
    if first.mirrored is None or second.mirrored is None:
        return MirroredDistances(straight)
    return MirroredDistances(straight, first.mirrored + second.mirrored)


def signature_batches(encodings: Sequence[Encoding]) -> list[SignatureBatch]:
    """Signatures of all views, stream by stream."""
    streams = zip(*(encoding.signatures for encoding in encodings), strict=True)
    return [SignatureBatch.stack(signatures) for signatures in streams]


def _stream_matrix(
    encoder: Encoder,
    number: int,
    queries: SignatureBatch,
    others: SignatureBatch | None,
    progress: Progress | None,
) -> FloatArray:
    """Distances by one stream, times its share."""
    from depthprint.emd import difference_matrix
    from depthprint.encoding import ground_distance

    stream, shifts = encoder.settings.streams[number], encoder.shifts()
    matrix = difference_matrix(
        queries,
        others,
        masses=stream.masses,
        ground=ground_distance(stream, encoder.settings),
        form=stream.form,
        shifts=None if shifts is None else shifts[number],
        progress=progress,
    )
    return np.asarray(encoder.settings.stream_weights[number] * matrix, dtype=np.float64)


def relaxed_distances(
    encoder: Encoder, encodings: Sequence[Encoding], progress: Progress | None = None
) -> FloatArray:
    """Lower bounds (n, n) of the distances that ``complexity_distances`` gives: those that the search prunes by."""
    index = encoder.make_index()
    for encoding in encodings:
        index.add(encoding.signatures)
    rows = np.empty((len(encodings), len(encodings)))
    for number, encoding in enumerate(encodings):
        rows[number] = index.distances(encoding.signatures, relaxed=True)
        if encoding.mirrored is not None:
            np.minimum(
                rows[number], index.distances(encoding.mirrored.signatures, relaxed=True), out=rows[number]
            )
        if progress is not None:
            progress(number + 1, len(encodings))
    return np.minimum(rows, rows.T)


def cosine_distances(encoder: Encoder, queries: Sequence[Encoding]) -> FloatArray:
    """One minus the weighted mean cosine of the streams' pooled codes; the nearer of a view and its mirror image."""
    return compare_codes(encoder, queries).nearer()


def compare_codes(
    encoder: Encoder,
    queries: Sequence[Encoding],
    others: Sequence[Encoding] | None = None,
    *,
    shares: Mapping[int, float] | None = None,
) -> MirroredDistances:
    """One minus the weighted mean cosine of the streams' pooled codes, (n, m) or symmetric (n, n).

    shares: of the streams that count, by their numbers; those of all streams where None.
    """
    targets = queries if others is None else others
    weights = dict(enumerate(encoder.settings.stream_weights)) if shares is None else shares
    straight = _code_distances(weights, queries, targets)
    if not encoder.settings.mirror:
        return MirroredDistances(straight)
    flipped = _code_distances(weights, [q.mirrored for q in queries if q.mirrored is not None], targets)
    # Among the views themselves equal but for rounding: mirroring both changes nothing.
    return MirroredDistances(straight, (flipped + flipped.T) / 2 if others is None else flipped)


def _code_distances(
    shares: Mapping[int, float], queries: Sequence[Encoding], targets: Sequence[Encoding]
) -> FloatArray:
    distances = np.ones((len(queries), len(targets)))
    for number, weight in shares.items():
        stored = _unit_rows([t.vectors[number] for t in targets])
        distances -= weight * (_unit_rows([q.vectors[number] for q in queries]) @ stored.T)
    return np.maximum(distances, 0.0)


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
