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
    both: of the sums of each one's vector and its mirror image's.
    """

    straight: Float32Array
    crossed: Float32Array
    both: Float32Array

    def __post_init__(self) -> None:
        for array in (self.straight, self.crossed, self.both):
            array.setflags(write=False)

    def summed(
        self, rows: IndexArray, stored: IndexArray, *, among: bool = False, partial: bool = False
    ) -> Float32Array:
        """Kernel of the sums of a view's vector and its mirror image's, of unit length: ``rows`` with ``stored``.

        partial: then with the partial copies of ``stored``. among: the rows of the copies follow; ``rows`` are then
        ``stored``.
        """
        kernels = self.both if partial else self.both[:1]
        # Of views, and of copies: the first and the last of three.
        lengths = [np.sqrt(np.maximum(np.diag(kernels[n]), 1e-12)) for n in (0, -1)]
        blocks = [
            kernel[np.ix_(rows, stored)] / first[rows, None] / second[stored]
            for kernel, first, second in zip(
                kernels,
                (lengths[0], lengths[0], lengths[1]),
                (lengths[0], lengths[1], lengths[1]),
                strict=False,
            )
        ]
        return _joined(blocks, among)

    def nearer(
        self, rows: IndexArray, stored: IndexArray, *, among: bool = False, partial: bool = False
    ) -> Float32Array:
        """One minus the cosine, of the nearer of a view and its mirror image; arguments as ``summed`` has them."""
        grid = (slice(None if partial else 1), *np.ix_(rows, stored))
        cosine = np.maximum(self.straight[grid], self.crossed[grid])
        return _joined(np.maximum(1.0 - cosine, 0.0), among)

    def with_mirrored(self, rows: IndexArray, stored: IndexArray, *, among: bool = False) -> Float32Array:
        """Products of views ``rows`` with views ``stored`` and their mirror images.

        among: the rows of the mirror images follow; ``rows`` are then ``stored``.
        """
        straight, crossed = (kernel[0][np.ix_(rows, stored)] for kernel in (self.straight, self.crossed))
        # What two mirror images have in common is what the views have.
        return _joined([straight, crossed, straight], among)


def _joined(blocks: Sequence[Float32Array] | Float32Array, among: bool) -> Float32Array:
    """Blocks of first with first, first with second and second with second, as one symmetric matrix or its top."""
    if len(blocks) == 1:
        return blocks[0]
    first, across, second = blocks
    top = np.concatenate([first, across], axis=1)
    return np.concatenate([top, np.concatenate([across.T, second], axis=1)]) if among else top


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
        straight, crossed, both = (
            np.asarray(sum(getattr(kernels, name) for kernels, _ in chosen) / count)
            for name in ("straight", "crossed", "both")
        )
        return SurfaceKernels(straight, crossed, both) if mirror else SurfaceKernels(*[straight] * 3)

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
                kernels = SurfaceKernels(
                    summed.straight + kernels.straight,
                    summed.crossed + kernels.crossed,
                    summed.both + kernels.both,
                )
            self._sums[kind == SIZE] = kernels, 1 if before is None else count + 1


def _kernels(
    views: tuple[Float32Array, Float32Array], copies: tuple[Float32Array, Float32Array]
) -> SurfaceKernels:
    pairs = ((views, views), (views, copies), (copies, copies))
    straight = np.stack([first[0] @ second[0].T for first, second in pairs])
    crossed = np.stack([first[0] @ second[1].T for first, second in pairs])
    # By sums, not by adding products up: the discriminant needs them positive semi-definite.
    both = np.stack([(first[0] + first[1]) @ (second[0] + second[1]).T for first, second in pairs])
    for number in (0, 2):
        # Equal but for rounding: mirroring both changes nothing.
        crossed[number] = np.float32(0.5) * (crossed[number] + crossed[number].T)
    return SurfaceKernels(straight, crossed, both)
