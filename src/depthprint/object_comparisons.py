"""Views of objects described and compared once, for all methods that use one encoder."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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

__all__ = ["ObjectComparisons", "SurfaceComparisons", "SurfaceKernels"]

Progress = Callable[[int, int], None]
IndexArray = npt.NDArray[np.int64]
Float32Array = npt.NDArray[np.float32]
T = TypeVar("T")


@dataclass(frozen=True)
class SurfaceKernels:
    """Inner products of the views' surface vectors, (n, n) each, read-only.

    straight: of views. crossed: of views with mirror images of views; equal to ``straight`` where the preset does not
    mirror.
    """

    straight: Float32Array
    crossed: Float32Array

    def __post_init__(self) -> None:
        for array in (self.straight, self.crossed):
            array.setflags(write=False)

    def summed(self) -> Float32Array:
        """Kernel of the sums of a view's vector and its mirror image's, of unit length."""
        kernel = self.straight + self.crossed
        lengths = np.sqrt(np.maximum(np.diag(kernel), 1e-12))
        return np.asarray(kernel / lengths[:, None] / lengths)

    def nearer(self) -> Float32Array:
        """One minus the cosine, of the nearer of a view and its mirror image."""
        return np.asarray(np.maximum(1.0 - np.maximum(self.straight, self.crossed), 0.0))

    def with_mirrored(self, rows: IndexArray, stored: IndexArray, both: bool) -> Float32Array:
        """Products of views ``rows`` with views ``stored`` and their mirror images.

        both: the rows of their own mirror images follow.
        """
        straight, crossed = (kernel[np.ix_(rows, stored)] for kernel in (self.straight, self.crossed))
        upper = np.concatenate([straight, crossed], axis=1)
        if not both:
            return upper
        # What two mirror images have in common is what the views have.
        return np.concatenate([upper, np.concatenate([crossed, straight], axis=1)])


class SurfaceComparisons:
    """Kernels of the views' surfaces, which encoders have no part in: one object may serve several of them."""

    def __init__(self, words: SurfaceWords | None = None) -> None:
        self._words = words
        self._images: Sequence[RangeImage] | None = None
        self._kernels: dict[tuple[str, bool], SurfaceKernels] = {}

    def kernels(
        self,
        images: Sequence[RangeImage],
        *,
        mirror: bool,
        without: str = "",
        progress: Progress | None = None,
    ) -> SurfaceKernels:
        """Kernels of all kinds of descriptors or all but one; those of the images given last are remembered."""
        if images is not self._images:
            self._images = images
            self._kernels.clear()
        if self._words is None:
            self._words = SurfaceWords.load()
        kinds = [kind for kind in self._words.vocabularies if kind != without]
        for kind in kinds:
            if (kind, mirror) not in self._kernels:
                straight, mirrored = self._words.only(kind).features(images, mirror=mirror, progress=progress)
                crossed = straight @ mirrored.T
                # Equal but for rounding: mirroring both changes nothing.
                self._kernels[kind, mirror] = SurfaceKernels(
                    straight @ straight.T, np.float32(0.5) * (crossed + crossed.T)
                )
        chosen = [self._kernels[kind, mirror] for kind in kinds]
        straight, crossed = (
            np.asarray(np.mean([getattr(k, name) for k in chosen], axis=0), dtype=np.float32)
            for name in ("straight", "crossed")
        )
        return SurfaceKernels(straight, crossed)


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

    def surfaces(self) -> SurfaceKernels:
        """Kernels of the views' surfaces."""
        return self._once("surfaces", self._surface_kernels)

    def sizeless(self) -> SurfaceKernels:
        """Kernels of the views' surfaces, the size kind left out."""
        return self._once("sizeless", lambda: self._surface_kernels("size"))

    def _surface_kernels(self, without: str = "") -> SurfaceKernels:
        if self._images is None:
            raise DataError("ObjectComparisons: expected prepare() to be called first")
        mirror = self.encoder.settings.mirror
        return self.shared_surfaces.kernels(
            self._images, mirror=mirror, without=without, progress=self._progress
        )

    def _once(self, kind: str, compute: Callable[[], T]) -> T:
        if kind not in self._done:
            started = time.perf_counter()
            self._done[kind] = compute()
            self.seconds[kind] = time.perf_counter() - started
        return self._done[kind]  # type: ignore[return-value]
