"""NCD by a real compressor on the depth image: what the paper argues against (section 3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.baselines.vector_store import nearest_matches
from depthprint.complexity import CompressorPool, compressed_length
from depthprint.ncd import ncd
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch
from depthprint.resampling import fill_holes, resample

__all__ = ["CompressedImage", "CompressionRecognizer", "image_bytes"]


def image_bytes(image: RangeImage, size: int = 32, levels: int = 32) -> bytes:
    """Depth as size x size bytes (1 x size^2 / 4 for a planar scan): log depth in ``levels`` steps, by quantiles."""
    image.require_returns()
    rows, columns = (1, size * size // 4) if image.projection.height == 1 else (size, size)
    source = image
    if image.mask is not None and (image.mask & image.valid).any():
        inside = image.mask & image.valid
        ys, xs = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
        source = image.cropped(int(xs[0]), int(ys[0]), int(xs[-1] - xs[0] + 1), int(ys[-1] - ys[0] + 1))
    depth = np.log(fill_holes(resample(source, columns, rows).ranges_m))
    low, high = np.quantile(depth, [0.02, 0.98])
    steps = np.clip((depth - low) / max(float(high - low), 1e-6), 0.0, 1.0) * (levels - 1)
    return bytes(np.round(steps).astype(np.uint8))


@dataclass(frozen=True)
class CompressedImage:
    """Bytes of an image and their compressed length."""

    data: bytes
    length: float


class CompressionRecognizer:
    """Eq. 8 with gzip, bz2, PPM, lzma or zstd as C; nothing is learned."""

    def __init__(self, compressor: str, *, size: int = 32, workers: int = 2) -> None:
        self._compressor = compressor
        self._size = size
        self._places: list[CompressedImage] = []
        self._pool = CompressorPool(compressor, workers)

    def fit(self, images: Sequence[RangeImage]) -> CompressionRecognizer:
        """Nothing to learn."""
        return self

    def describe(self, image: RangeImage) -> CompressedImage:
        """Serialise and compress one frame."""
        data = image_bytes(image, self._size)
        return CompressedImage(data, compressed_length(data, self._compressor))

    def add(self, description: CompressedImage) -> int:
        """Store a place."""
        self._places.append(description)
        return len(self._places) - 1

    def query(self, description: CompressedImage, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        """Nearest places by brute force."""
        places = self._places[: len(self._places) if limit is None else max(0, limit)]
        return nearest_matches(self.distances(description, places), k)

    def distances(self, first: CompressedImage, others: Sequence[CompressedImage]) -> npt.NDArray[np.float64]:
        """NCD of one byte string and each of others, the other after it."""
        joint = self._pool.lengths([first.data + other.data for other in others])
        alone = np.array([other.length for other in others], dtype=np.float64)
        return np.asarray(ncd(first.length, alone, np.array(joint, dtype=np.float64)))

    def distance(self, first: CompressedImage, second: CompressedImage) -> float:
        """NCD of the two byte strings, the second after the first."""
        return float(self.distances(first, [second])[0])
