"""Surfaces of views compared once for all methods: views, their mirror images, and partial copies of both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.partial_views import partial_copies
from depthprint.range_image import RangeImage
from depthprint.surface_words import SurfaceWords

__all__ = ["SurfaceComparisons", "SurfaceKernels"]

Progress = Callable[[int, int], None]
IndexArray = npt.NDArray[np.int64]
Float32Array = npt.NDArray[np.float32]

SIZE = "size"


@dataclass(frozen=True)
class SurfaceKernels:
    """Inner products of the views' surface vectors, (3, n, n) each, read-only.

    First of views with views, then of views with partial copies of views, then of copies with copies. straight: as they
    are. crossed: with the mirror images of the second ones; equal to ``straight`` where the preset does not mirror.
    """

    straight: Float32Array
    crossed: Float32Array

    def __post_init__(self) -> None:
        for array in (self.straight, self.crossed):
            array.setflags(write=False)

    def summed(self) -> Float32Array:
        """Kernel (n, n) of the sums of a view's vector and its mirror image's, of unit length."""
        kernel = self.straight[0] + self.crossed[0]
        lengths = np.sqrt(np.maximum(np.diag(kernel), 1e-12))
        return np.asarray(kernel / lengths[:, None] / lengths)

    def nearer(self) -> Float32Array:
        """One minus the cosine (n, n), of the nearer of a view and its mirror image."""
        return np.asarray(np.maximum(1.0 - np.maximum(self.straight[0], self.crossed[0]), 0.0))

    def machine_kernel(
        self, rows: IndexArray, stored: IndexArray, *, among: bool, partial: bool
    ) -> Float32Array:
        """Products of views ``rows`` with views ``stored`` and their mirror images.

        partial: then also with the partial copies of ``stored`` and theirs. among: the rows of all these follow in the
        same order; ``rows`` are then ``stored``.
        """
        whole = self._with_mirrored(0, rows, stored, among)
        if not partial:
            return whole
        across = self._with_mirrored(1, rows, stored, among)
        if not among:
            return np.concatenate([whole, across], axis=1)
        rows_of_copies = np.concatenate([across.T, self._with_mirrored(2, rows, stored, among)], axis=1)
        return np.concatenate([np.concatenate([whole, across], axis=1), rows_of_copies])

    def _with_mirrored(self, number: int, rows: IndexArray, stored: IndexArray, among: bool) -> Float32Array:
        straight, crossed = (kernel[number][np.ix_(rows, stored)] for kernel in (self.straight, self.crossed))
        upper = np.concatenate([straight, crossed], axis=1)
        if not among:
            return upper
        # What two mirror images have in common is what the views have.
        return np.concatenate([upper, np.concatenate([crossed, straight], axis=1)])


class SurfaceComparisons:
    """Kernels of the views' surfaces, which encoders have no part in: one object may serve several of them."""

    def __init__(self, words: SurfaceWords | None = None) -> None:
        self._words = words
        self._images: Sequence[RangeImage] | None = None
        # Sums over the kinds of descriptors, size and the others; and how many these are.
        self._sums: dict[bool, tuple[SurfaceKernels, int]] = {}

    def kernels(
        self,
        images: Sequence[RangeImage],
        *,
        mirror: bool,
        sized: bool = True,
        progress: Progress | None = None,
    ) -> SurfaceKernels:
        """Mean kernels of all kinds of descriptors, or all but size; the images given last are described once."""
        if images is not self._images:
            self._sums = {}
            self._describe(images, progress)
            self._images = images
        chosen = [self._sums[is_size] for is_size in self._sums if sized or not is_size]
        count = np.float32(sum(n for _, n in chosen))
        straight = np.asarray(sum(kernels.straight for kernels, _ in chosen) / count)
        if not mirror:
            return SurfaceKernels(straight, straight)
        return SurfaceKernels(straight, np.asarray(sum(kernels.crossed for kernels, _ in chosen) / count))

    def _describe(self, images: Sequence[RangeImage], progress: Progress | None) -> None:
        words = SurfaceWords.load() if self._words is None else self._words
        copies = partial_copies(images)
        for kind in words.vocabularies:
            alone = words.only(kind)
            whole = alone.features(images, progress=progress)
            kernels = _kernels(whole, alone.features(copies, progress=progress))
            before = self._sums.get(kind == SIZE)
            if before is not None:
                summed, count = before
                kernels = SurfaceKernels(summed.straight + kernels.straight, summed.crossed + kernels.crossed)
            self._sums[kind == SIZE] = kernels, 1 if before is None else count + 1


def _kernels(
    views: tuple[Float32Array, Float32Array], copies: tuple[Float32Array, Float32Array]
) -> SurfaceKernels:
    pairs = ((views, views), (views, copies), (copies, copies))
    straight = np.stack([first[0] @ second[0].T for first, second in pairs])
    crossed = np.stack([first[0] @ second[1].T for first, second in pairs])
    for number in (0, 2):
        # Equal but for rounding: mirroring both changes nothing.
        crossed[number] = np.float32(0.5) * (crossed[number] + crossed[number].T)
    return SurfaceKernels(straight, crossed)
