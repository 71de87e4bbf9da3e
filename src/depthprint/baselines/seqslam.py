"""SeqSLAM: not single frames but short drives are compared, over a difference matrix with enhanced contrast.

After Milford & Wyeth, "SeqSLAM: Visual Route-Based Navigation for Sunny Summer Days and Stormy Winter Nights", ICRA
2012, over smoothed depth images; causal, since only frames already seen are part of a drive.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.baselines.pixel_l2 import pixel_vector
from depthprint.baselines.vector_store import VectorStore, nearest_matches
from depthprint.errors import SettingsError
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch

__all__ = ["SeqSlamRecognizer", "enhanced_contrast"]

Float32Array = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]


def enhanced_contrast(differences: npt.ArrayLike, window: int) -> FloatArray:
    """Differences (n,) of a frame to places in order, each less its neighbourhood's mean, in its deviations.

    window: places in the neighbourhood, cut at the ends. Where all are equal the result is 0.
    Raises SettingsError for a window under 2.
    """
    if window < 2:
        raise SettingsError(f"enhanced_contrast: expected a window of at least 2, got {window}")
    values = np.asarray(differences, dtype=np.float64)
    # sums of squares about the mean lose fewer digits
    centred = values - values.mean() if len(values) else values
    low = np.maximum(np.arange(len(values)) - window // 2, 0)
    high = np.minimum(low + window, len(values))
    low = np.maximum(high - window, 0)
    count = np.maximum(high - low, 1)
    sums, squares = (np.concatenate([[0.0], np.cumsum(v)]) for v in (centred, centred**2))
    mean = (sums[high] - sums[low]) / count
    deviation = np.sqrt(np.maximum((squares[high] - squares[low]) / count - mean**2, 0.0))
    floor = 1e-6 * max(float(np.abs(centred).max(initial=0.0)), 1e-12)
    return np.asarray(np.where(deviation > floor, (centred - mean) / np.maximum(deviation, floor), 0.0))


class SeqSlamRecognizer:
    """Mean contrast-enhanced difference along the best straight line through the last ``frames`` frames.

    The frames before a query are those added last. A line ends at the query's place and goes back at one of
    ``speeds`` (places a frame); what lies before the first place or the first frame counts as neither alike nor
    unlike.

    size: pixels a side. window: places that contrast is enhanced over. centred: as of ``PixelL2Recognizer``.
    """

    def __init__(
        self,
        *,
        size: int = 32,
        frames: int = 10,
        window: int = 20,
        speeds: Sequence[float] = (0.8, 0.9, 1.0, 1.1, 1.25),
        centred: bool = True,
    ) -> None:
        if size < 2 or frames < 1 or window < 2 or not speeds or min(speeds) <= 0:
            raise SettingsError(
                "SeqSlamRecognizer: expected size >= 2, frames >= 1, window >= 2 and speeds > 0, "
                f"got {size}, {frames}, {window} and {tuple(speeds)}"
            )
        self._size = size
        self._frames = frames
        self._window = window
        self._steps = [np.round(np.arange(frames) * speed).astype(np.int64) for speed in speeds]
        self._centred = centred
        self._store = VectorStore()
        self._squares: list[float] = []
        self._recent: deque[FloatArray] = deque(maxlen=max(frames - 1, 1))

    def fit(self, images: Sequence[RangeImage]) -> SeqSlamRecognizer:
        """Nothing to learn."""
        return self

    def describe(self, image: RangeImage) -> Float32Array:
        """Smoothed depth as a vector."""
        vector = pixel_vector(image, self._size, smoothing=self._size / 48)
        return vector - vector.mean() if self._centred else vector

    def add(self, description: Float32Array) -> int:
        """Store a place; it becomes the latest frame before the next query."""
        self._recent.append(self._differences(description, len(self._store)))
        self._squares.append(float(description @ description))
        return self._store.add(description)

    def query(self, description: Float32Array, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        """Places where the best lines end. Their distance is in deviations: negative where more alike than around."""
        n = len(self._store.rows(limit))
        if not n:
            return []
        earlier = [row[:n] for row in reversed(self._recent)][: self._frames - 1]
        rows = [enhanced_contrast(row, self._window) for row in [self._differences(description, n), *earlier]]
        totals = np.zeros((len(self._steps), n))
        for total, steps in zip(totals, self._steps, strict=True):
            for row, back in zip(rows, [int(step) for step in steps], strict=False):
                # a recent frame knows only the places older than itself
                ends = min(n, len(row) + back)
                total[back:ends] += row[: max(0, ends - back)]
        return nearest_matches(totals.min(axis=0) / self._frames, k)

    def distance(self, first: Float32Array, second: Float32Array) -> float:
        """Root mean square difference of two frames, metres: what the lines of a query are made of."""
        return float(np.sqrt(np.mean((first - second) ** 2)))

    def _differences(self, description: Float32Array, n: int) -> FloatArray:
        if not n:
            return np.empty(0)
        squares = np.asarray(self._squares[:n]) + float(description @ description)
        rough = squares - 2.0 * (self._store.rows(n) @ description).astype(np.float64)
        return np.sqrt(np.maximum(rough, 0.0) / len(description))
