"""Methods that name objects by a linear support vector machine over features of their views."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.described_views import DescribedViews, inner_products
from depthprint.baselines.linear_svm import GramSvm
from depthprint.errors import DataError
from depthprint.range_image import RangeImage

__all__ = ["FixedFeatures", "KernelDescriptorViews", "LinearSvmMethod", "ViewFeatures"]

Float32Array = npt.NDArray[np.float32]
IndexArray = npt.NDArray[np.int64]
Products = tuple[Float32Array, Float32Array]
Progress = Callable[[int, int], None]


class ViewFeatures(Protocol):
    """What a linear method knows of the views."""

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Describe all views, without labels, learning nothing from them."""

    def blocks(self, train: IndexArray, test: IndexArray) -> Iterator[tuple[Float32Array, Float32Array]]:
        """Features of training and test views, group of columns by group; what is learned, from ``train`` alone.

        Where mirrored views train too, their rows follow the straight ones.
        """

    def products(self, train: IndexArray, test: IndexArray) -> Products:
        """Inner products (n, n) among training rows, and (m, n) of test rows with them, over all columns."""


class LinearSvmMethod:
    """An object method: one-vs-rest squared-hinge machine (GramSvm) over features of single views.

    name, us_per_pair: as ObjectMethod has them; there are no pairs, so the latter is NaN.
    """

    def __init__(self, name: str, features: ViewFeatures, *, C: float) -> None:
        self.name = name
        self.us_per_pair = float("nan")
        self.features = features
        self._C = C

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Describe all views once."""
        self.features.prepare(images, progress)

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[npt.NDArray[np.float64], IndexArray]:
        """Margins (n_test, n_labels), and the labels (n_labels,) of their columns; views may be added up."""
        among, across = self.features.products(train, test)
        machine = GramSvm(self._C).fit(among, np.tile(train_labels, len(among) // len(train)))
        return machine.scores(across), np.asarray(machine.labels)

    def likeness(self, train: IndexArray, test: IndexArray) -> Float32Array:
        """Inner product (n_test, n_train) with each training view, or with its mirror image where that is larger."""
        _, across = self.features.products(train, test)
        return np.asarray(across.reshape(len(test), -1, len(train)).max(axis=1))

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

    def products(self, train: IndexArray, test: IndexArray) -> Products:
        """Products of whole rows."""
        return _summed(inner_products(*block) for block in self.blocks(train, test))


class KernelDescriptorViews:
    """Match features of one or several kernel descriptors, side by side.

    masked: leave out the depth around the object. mirror: mirrored views train too. turned: turned copies of both do.
    ``described`` holds what methods of
    the same options may share.
    """

    def __init__(
        self,
        kinds: Sequence[str],
        *,
        mirror: bool = False,
        masked: bool = False,
        turned: bool = False,
        n_words: int = 1000,
        seed: int = 0,
    ) -> None:
        self.described = DescribedViews(
            mirror=mirror, masked=masked, turned=turned, n_words=n_words, seed=seed
        )
        self._kinds = tuple(kinds)

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Compute all descriptors that are not there; ``progress`` counts views over all kinds."""
        self.described.prepare(images, self._kinds, progress)

    def blocks(self, train: IndexArray, test: IndexArray) -> Iterator[tuple[Float32Array, Float32Array]]:
        """One block a kind."""
        for kind in self._kinds:
            yield self.described.features(kind, train, test)

    def products(self, train: IndexArray, test: IndexArray) -> Products:
        """Sums over the kinds."""
        return _summed(self.described.products(kind, train, test) for kind in self._kinds)


def _summed(products: Iterator[Products]) -> Products:
    """Sums of products, never more than two in memory."""
    among, across = next(products)
    for more_among, more_across in products:
        among, across = among + more_among, across + more_across
    return among, across
