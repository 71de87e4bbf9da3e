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
from depthprint.objects.distances import (
    MirroredDistances,
    compare_codes,
    compare_complexities,
    relaxed_distances,
)
from depthprint.objects.kernels import code_features, picture_shares
from depthprint.objects.surface_comparisons import SurfaceComparisons, SurfaceKernels
from depthprint.range_image import RangeImage

__all__ = ["ObjectComparisons"]

Progress = Callable[[int, int], None]
T = TypeVar("T")


class ObjectComparisons:
    """Encodings of views, and each kind of comparison of them all, computed when first asked for.

    ``seconds`` tells how long each kind took. Another sequence of images forgets everything.
    """

    def __init__(self, encoder: Encoder, surfaces: SurfaceComparisons | None = None) -> None:
        self.encoder = encoder
        self.shared_surfaces = SurfaceComparisons() if surfaces is None else surfaces
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
        self._described()
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

    def pictures(self) -> MirroredDistances:
        """The same without the streams of pairs of points."""
        shares = picture_shares(self.encoder.settings)
        return self._once("pictures", lambda: compare_codes(self.encoder, self.encodings, shares=shares))

    def features(self) -> npt.NDArray[np.float32]:
        """Features (n, d) of the kernel of the pooled codes, without the streams of pairs."""
        return self._once("features", lambda: code_features(self.encoder, self.encodings))

    def code_kernel(self) -> npt.NDArray[np.float32]:
        """Kernel (n, n) of the pooled codes, without the streams of pairs."""
        return self._once("code_kernel", lambda: self.features() @ self.features().T)

    def surfaces(self) -> SurfaceKernels:
        """Kernels of the views' surfaces."""
        return self._once("surfaces", self._surface_kernels)

    def sizeless(self) -> SurfaceKernels:
        """Kernels of the views' surfaces, the size kind left out."""
        return self._once("sizeless", lambda: self._surface_kernels(sized=False))

    def pairs(self) -> SurfaceKernels:
        """Kernels of the surfaces' pairs of points."""
        return self._once("pairs", lambda: self.shared_surfaces.pairs(self._described(), self._progress))

    def turned(self) -> SurfaceKernels:
        """Kernels of the views' surfaces, turned copies among them."""
        return self._once("turned", lambda: self._surface_kernels(turned=True))

    def _surface_kernels(self, sized: bool = True, turned: bool = False) -> SurfaceKernels:
        mirror = self.encoder.settings.mirror
        return self.shared_surfaces.kernels(
            self._described(), mirror=mirror, sized=sized, turned=turned, progress=self._progress
        )

    def _described(self) -> Sequence[RangeImage]:
        if self._images is None:
            raise DataError("ObjectComparisons: expected prepare() to be called first")
        return self._images

    def _once(self, kind: str, compute: Callable[[], T]) -> T:
        if kind not in self._done:
            started = time.perf_counter()
            self._done[kind] = compute()
            self.seconds[kind] = time.perf_counter() - started
        return self._done[kind]  # type: ignore[return-value]
