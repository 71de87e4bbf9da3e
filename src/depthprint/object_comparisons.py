"""Views of objects described and compared once, for all methods that use one encoder."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.errors import DataError
from depthprint.object_distances import (
    MirroredDistances,
    compare_codes,
    compare_complexities,
    relaxed_distances,
)
from depthprint.object_kernels import code_features
from depthprint.range_image import RangeImage
from depthprint.surface_words import SurfaceWords

__all__ = ["ObjectComparisons", "SurfaceComparisons"]

Progress = Callable[[int, int], None]
T = TypeVar("T")


class SurfaceComparisons:
    """Kernels of the views' surfaces, which encoders have no part in: one object may serve several of them."""

    def __init__(self, words: SurfaceWords | None = None) -> None:
        self._words = words
        self._images: Sequence[RangeImage] | None = None
        self._kernels: dict[tuple[str, bool], npt.NDArray[np.float32]] = {}

    def kernel(
        self,
        images: Sequence[RangeImage],
        *,
        mirror: bool,
        without: str = "",
        progress: Progress | None = None,
    ) -> npt.NDArray[np.float32]:
        """Kernel (n, n), of all kinds of descriptors or all but one; the images given last are remembered."""
        if images is not self._images:
            self._images = images
            self._kernels.clear()
        if self._words is None:
            self._words = SurfaceWords.load()
        kinds = [kind for kind in self._words.vocabularies if kind != without]
        total = np.zeros((len(images), len(images)), dtype=np.float32)
        for kind in kinds:
            if (kind, mirror) not in self._kernels:
                rows = self._words.only(kind).features(images, mirror=mirror, progress=progress)
                self._kernels[kind, mirror] = rows @ rows.T
            total += self._kernels[kind, mirror]
        return total / np.float32(len(kinds))


class ObjectComparisons:
    """Encodings of views, and each kind of comparison of them all, computed when first asked for.

    ``seconds`` tells how long each kind took. Another sequence of images forgets everything.
    """

    def __init__(self, encoder: Encoder, surfaces: SurfaceComparisons | None = None) -> None:
        self.encoder = encoder
        self.surfaces = SurfaceComparisons() if surfaces is None else surfaces
        self.seconds: dict[str, float] = {}
        self._images: Sequence[RangeImage] | None = None
        self._encodings: list[Encoding] = []
        self._done: dict[str, object] = {}
        self._progress: Progress | None = None

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Encode the views; nothing happens for those that were given last."""
        self._progress = progress
        if images is self._images:
            return
        self._encodings = self.encoder.describe_many(images, progress)
        self._images = images
        self._done.clear()
        self.seconds.clear()

    @property
    def encodings(self) -> Sequence[Encoding]:
        """Encodings of all views; DataError before ``prepare``."""
        if self._images is None:
            raise DataError("ObjectComparisons: expected prepare() to be called first")
        return self._encodings

    def complexities(self) -> MirroredDistances:
        """Normalised information distances of all pairs."""
        return self._once(
            "complexities",
            lambda: compare_complexities(self.encoder, self.encodings, progress=self._progress),
        )

    def relaxed(self) -> npt.NDArray[np.float64]:
        """Lower bounds of the information distances of all pairs."""
        return self._once("relaxed", lambda: relaxed_distances(self.encoder, self.encodings, self._progress))

    def codes(self) -> MirroredDistances:
        """Cosine distances of the pooled codes of all pairs."""
        return self._once("codes", lambda: compare_codes(self.encoder, self.encodings))

    def features(self) -> npt.NDArray[np.float32]:
        """Features (n, d) of the kernel of the pooled codes."""
        return self._once("features", lambda: code_features(self.encoder, self.encodings))

    def code_kernel(self) -> npt.NDArray[np.float32]:
        """Kernel (n, n) of the pooled codes."""
        return self._once("code_kernel", lambda: self.features() @ self.features().T)

    def surface_kernel(self) -> npt.NDArray[np.float32]:
        """Kernel (n, n) of the views' surfaces."""
        return self._once("surface_kernel", self._surface_kernel)

    def sizeless_kernel(self) -> npt.NDArray[np.float32]:
        """Kernel (n, n) of the views' surfaces, the size kind left out."""
        return self._once("sizeless_kernel", lambda: self._surface_kernel("size"))

    def _surface_kernel(self, without: str = "") -> npt.NDArray[np.float32]:
        if self._images is None:
            raise DataError("ObjectComparisons: expected prepare() to be called first")
        mirror = self.encoder.settings.mirror
        return self.surfaces.kernel(self._images, mirror=mirror, without=without, progress=self._progress)

    def _once(self, kind: str, compute: Callable[[], T]) -> T:
        if kind not in self._done:
            started = time.perf_counter()
            self._done[kind] = compute()
            self.seconds[kind] = time.perf_counter() - started
        return self._done[kind]  # type: ignore[return-value]
