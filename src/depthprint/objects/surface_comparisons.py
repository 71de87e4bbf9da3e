"""Surfaces of views compared once for all methods: views, partial and turned copies, and mirror images of all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.objects.surface_words import SurfaceWords
from depthprint.partial_views import partial_copies
from depthprint.range_image import RangeImage
from depthprint.surflet_pairs import pair_vectors
from depthprint.turned_views import TURNS_DEG, turned_copies

__all__ = ["PARTIAL", "TURNED", "VIEWS", "SurfaceComparisons", "SurfaceKernels"]

Progress = Callable[[int, int], None]
IndexArray = npt.NDArray[np.int64]
Float32Array = npt.NDArray[np.float32]

SIZE = "size"

# Numbers of the copies: the views themselves, partly hidden, and turned.
VIEWS, PARTIAL = 0, 1
TURNED = tuple(range(2, 2 + len(TURNS_DEG)))


@dataclass(frozen=True)
class SurfaceKernels:
    """Inner products of the views' surface vectors, (p, n, n) each, read-only.

    Of each pair of copies (VIEWS, PARTIAL, and those of TURNED): 0 with 0; 0 and 1 with 1; 0, 1 and 2 with 2; ...
    straight: as they are. crossed: with the mirror images of the second ones; equal to ``straight`` where the preset
    does not mirror. both: of the sums of each one's vector and its mirror image's.
    """

    straight: Float32Array
    crossed: Float32Array
    both: Float32Array

    def __post_init__(self) -> None:
        for array in (self.straight, self.crossed, self.both):
            array.setflags(write=False)

    def summed(
        self, rows: IndexArray, stored: IndexArray, *, copies: Sequence[int] = (VIEWS,), among: bool = False
    ) -> Float32Array:
        """Kernel of the sums of a view's vector and its mirror image's, of unit length: ``rows`` with ``stored``.

        copies: which copies of ``stored``, the first of them that of ``rows``. among: the rows of the other copies
        follow; ``rows`` are then ``stored``.
        """
        lengths = [np.sqrt(np.maximum(np.diag(_between(self.both, n, n)), 1e-12)) for n in copies]
        kernel = _joined(self.both, rows, stored, copies, among)
        kernel /= np.concatenate([length[stored] for length in lengths])
        first = lengths if among else lengths[:1]
        return np.asarray(kernel / np.concatenate([length[rows] for length in first])[:, None])

    def nearer(
        self, rows: IndexArray, stored: IndexArray, *, copies: Sequence[int] = (VIEWS,), among: bool = False
    ) -> Float32Array:
        """One minus the cosine, of the nearer of a view and its mirror image; arguments as ``summed`` has them."""
        straight, crossed = (
            _joined(kernels, rows, stored, copies, among) for kernels in (self.straight, self.crossed)
        )
        return np.asarray(np.maximum(1.0 - np.maximum(straight, crossed), 0.0))

    def with_mirrored(
        self, rows: IndexArray, stored: IndexArray, *, copies: Sequence[int] = (VIEWS,), among: bool = False
    ) -> Float32Array:
        """Products of views ``rows`` with copies of ``stored``, and then with the mirror images of these.

        copies, among: as ``summed`` has them; the rows of the mirror images follow those of all copies.
        """
        straight, crossed = (
            _joined(kernels, rows, stored, copies, among) for kernels in (self.straight, self.crossed)
        )
        top = np.concatenate([straight, crossed], axis=1)
        # What two mirror images have in common is what the views have.
        return np.concatenate([top, np.concatenate([crossed.T, straight], axis=1)]) if among else top


def _between(kernels: Float32Array, first: int, second: int) -> Float32Array:
    low, high = sorted((first, second))
    kernel = kernels[high * (high + 1) // 2 + low]
    return np.asarray(kernel if first <= second else kernel.T)


def _joined(
    kernels: Float32Array, rows: IndexArray, stored: IndexArray, copies: Sequence[int], among: bool
) -> Float32Array:
    """Blocks of copies side by side; ``among``: of all copies with all, else of the first with all."""
    grid = np.ix_(rows, stored)
    first = copies if among else copies[:1]
    return np.concatenate(
        [np.concatenate([_between(kernels, i, j)[grid] for j in copies], axis=1) for i in first]
    )


class SurfaceComparisons:
    """Kernels of the views' surfaces, which encoders have no part in: one object may serve several of them."""

    def __init__(self, words: SurfaceWords | None = None) -> None:
        self._words = words
        self._images: Sequence[RangeImage] | None = None
        self._turned = False
        # Sums over the kinds of descriptors, size and the others; and how many these are.
        self._sums: dict[bool, tuple[SurfaceKernels, int]] = {}
        self._paired: Sequence[RangeImage] | None = None
        self._pairs: SurfaceKernels | None = None

    def pairs(self, images: Sequence[RangeImage], progress: Progress | None = None) -> SurfaceKernels:
        """Kernels of the pairs of points of views and partial copies, which mirror images have alike."""
        if self._pairs is None or images is not self._paired:
            described = [pair_vectors(images, progress), pair_vectors(partial_copies(images))]
            alike = _kernels([(rows, rows) for rows in described])
            self._paired, self._pairs = images, SurfaceKernels(*[alike.straight] * 3)
        return self._pairs

    def kernels(
        self,
        images: Sequence[RangeImage],
        *,
        mirror: bool,
        sized: bool = True,
        turned: bool = False,
        progress: Progress | None = None,
    ) -> SurfaceKernels:
        """Mean kernels of all kinds of descriptors, or all but size; the images given last are described once.

        turned: of turned copies too; asked for after kernels without them, everything is described again.
        """
        if images is not self._images or (turned and not self._turned):
            self._sums = {}
            self._describe(images, turned, progress)
            self._images, self._turned = images, turned
        chosen = [self._sums[is_size] for is_size in self._sums if sized or not is_size]
        count = np.float32(sum(n for _, n in chosen))
        straight, crossed, both = (
            np.asarray(sum(getattr(kernels, name) for kernels, _ in chosen) / count)
            for name in ("straight", "crossed", "both")
        )
        return SurfaceKernels(straight, crossed, both) if mirror else SurfaceKernels(*[straight] * 3)

    def _describe(self, images: Sequence[RangeImage], turned: bool, progress: Progress | None) -> None:
        words = SurfaceWords.load() if self._words is None else self._words
        copies = [images, partial_copies(images)]
        if turned:
            copies += [turned_copies(images, *turn) for turn in TURNS_DEG]
        for kind in words.vocabularies:
            alone = words.only(kind)
            described = [alone.features(copies[0], progress=progress)]
            kernels = _kernels(described + [alone.features(c) for c in copies[1:]])
            before = self._sums.get(kind == SIZE)
            if before is not None:
                summed, count = before
                kernels = SurfaceKernels(
                    summed.straight + kernels.straight,
                    summed.crossed + kernels.crossed,
                    summed.both + kernels.both,
                )
            self._sums[kind == SIZE] = kernels, 1 if before is None else count + 1


def _kernels(copies: Sequence[tuple[Float32Array, Float32Array]]) -> SurfaceKernels:
    pairs = [(first, second) for n, second in enumerate(copies) for first in copies[: n + 1]]
    straight = np.stack([first[0] @ second[0].T for first, second in pairs])
    crossed = np.stack([first[0] @ second[1].T for first, second in pairs])
    # By sums, not by adding products up: the discriminant needs them positive semi-definite.
    sums = [straight_rows + mirrored_rows for straight_rows, mirrored_rows in copies]
    both = np.stack([first @ second.T for n, second in enumerate(sums) for first in sums[: n + 1]])
    for number, (first, second) in enumerate(pairs):
        if first is second:
            # Equal but for rounding: mirroring both changes nothing.
            crossed[number] = np.float32(0.5) * (crossed[number] + crossed[number].T)
    return SurfaceKernels(straight, crossed, both)
