"""Methods that name objects by a linear support vector machine over features of their views."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.kinds import KINDS, describe_crops
from depthprint.baselines.kernel_descriptors.match_features import (
    learn_vocabulary,
    match_features,
    power_transform,
)
from depthprint.baselines.kernel_descriptors.patch_grid import PatchDescriptors, mirrored_image
from depthprint.baselines.linear_svm import GramSvm, gram_matrix
from depthprint.errors import DataError
from depthprint.range_image import RangeImage

__all__ = ["FixedFeatures", "KernelDescriptorViews", "LinearSvmMethod", "ViewFeatures"]

Float32Array = npt.NDArray[np.float32]
IndexArray = npt.NDArray[np.int64]
Progress = Callable[[int, int], None]


class ViewFeatures(Protocol):
    """What a linear method knows of the views."""

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Describe all views, without labels, learning nothing from them."""

    def blocks(self, train: IndexArray, test: IndexArray) -> Iterator[tuple[Float32Array, Float32Array]]:
        """Features of training and test views, group of columns by group; what is learned, from ``train`` alone.

        Where mirrored views train too, their rows follow the straight ones.
        """


class LinearSvmMethod:
    """An object method: one-vs-rest squared-hinge machine (GramSvm) over features of single views.

    name, us_per_pair: as ObjectMethod has them; there are no pairs, so the latter is NaN.
    """

    def __init__(self, name: str, features: ViewFeatures, *, C: float) -> None:
        self.name = name
        self.us_per_pair = float("nan")
        self._features = features
        self._C = C

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Describe all views once."""
        self._features.prepare(images, progress)

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[npt.NDArray[np.float64], IndexArray]:
        """Margins (n_test, n_labels), and the labels (n_labels,) of their columns; views may be added up."""
        among, across = _inner_products(self._features.blocks(train, test))
        machine = GramSvm(self._C).fit(among, np.tile(train_labels, len(among) // len(train)))
        return machine.scores(across), np.asarray(machine.labels)

    def predict(self, train: IndexArray, train_labels: IndexArray, test: IndexArray) -> IndexArray:
        """Label of the largest margin."""
        scores, labels = self.scores(train, train_labels, test)
        return np.asarray(labels[scores.argmax(1)])


class FixedFeatures:
    """Features that depend on nothing but the view itself.

    describe: (images, progress) -> features (n, d) float32 of the views, and of their mirror images where these
    train too, else None.
    """

    def __init__(
        self,
        describe: Callable[[Sequence[RangeImage], Progress | None], tuple[Float32Array, Float32Array | None]],
    ) -> None:
        self._describe = describe
        self._straight: Float32Array | None = None
        self._mirrored: Float32Array | None = None

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Describe all views, and their mirror images where these train."""
        self._straight, self._mirrored = self._describe(images, progress)

    def blocks(self, train: IndexArray, test: IndexArray) -> Iterator[tuple[Float32Array, Float32Array]]:
        """All columns at once."""
        if self._straight is None:
            raise DataError("linear method: expected prepare() to be called before views are compared")
        known = self._straight[train]
        if self._mirrored is not None:
            known = np.concatenate([known, self._mirrored[train]])
        yield known, self._straight[test]


class KernelDescriptorViews:
    """Match features of one or several kernel descriptors, side by side.

    The descriptors of a view are the same for every split; the words are learned anew from the training views of
    each split, mirrored ones left out. masked: leave out the depth around the object. mirror: mirrored views
    train too.
    """

    def __init__(
        self,
        kinds: Sequence[str],
        *,
        mirror: bool = False,
        masked: bool = False,
        n_words: int = 1000,
        seed: int = 0,
    ) -> None:
        self._kinds = tuple(kinds)
        self._mirror = mirror
        self._masked = masked
        self._n_words = n_words
        self._seed = seed
        self._crops: dict[str, list[PatchDescriptors]] = {}
        self._mirrored: dict[str, list[PatchDescriptors]] = {}

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Compute all descriptors; ``progress`` counts views over all kinds."""
        rounds = [(kind, False) for kind in self._kinds]
        if self._mirror:
            rounds += [(kind, True) for kind in self._kinds if not KINDS[kind].mirror_free]
        turned = [mirrored_image(image) for image in images] if self._mirror else []
        for number, (kind, mirrored) in enumerate(rounds):

            def report(done: int, total: int, before: int = number * len(images)) -> None:
                if progress is not None:
                    progress(before + done, len(rounds) * len(images))

            crops = describe_crops(turned if mirrored else images, kind, masked=self._masked, progress=report)
            (self._mirrored if mirrored else self._crops)[kind] = crops
            if self._mirror and KINDS[kind].mirror_free:
                self._mirrored[kind] = [crop.mirrored() for crop in crops]

    def blocks(self, train: IndexArray, test: IndexArray) -> Iterator[tuple[Float32Array, Float32Array]]:
        """One block a kind."""
        if not self._crops:
            raise DataError("kernel descriptors: expected prepare() to be called before views are compared")
        for kind in self._kinds:
            known = [self._crops[kind][number] for number in train]
            vocabulary = learn_vocabulary(
                known, KINDS[kind].match_gamma, n_words=self._n_words, seed=self._seed
            )
            if self._mirror:
                known += [self._mirrored[kind][number] for number in train]
            asked = [self._crops[kind][number] for number in test]
            yield (
                power_transform(match_features(known, vocabulary)),
                power_transform(match_features(asked, vocabulary)),
            )


def _inner_products(blocks: Iterator[tuple[Float32Array, Float32Array]]) -> tuple[Float32Array, Float32Array]:
    """Products (n, n) among training rows and (m, n) of test rows with them; never all columns in memory."""
    known, asked = next(blocks)
    among, across = gram_matrix(known), asked @ known.T
    for known, asked in blocks:
        among += gram_matrix(known)
        across += asked @ known.T
    return among, across
