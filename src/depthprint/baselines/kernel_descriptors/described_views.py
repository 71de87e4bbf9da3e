"""Kernel descriptors of a set of views, and what a split makes of them: computed once for all rows of a table."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.kinds import KINDS, describe_crops
from depthprint.baselines.kernel_descriptors.match_features import (
    learn_vocabulary,
    match_features,
    power_transform,
)
from depthprint.baselines.kernel_descriptors.patch_grid import PatchDescriptors, mirrored_image
from depthprint.baselines.linear_svm import gram_matrix
from depthprint.errors import DataError
from depthprint.range_image import RangeImage
from depthprint.turned_views import TURNS_DEG, turned_copies

__all__ = ["DescribedViews", "inner_products"]

Float32Array = npt.NDArray[np.float32]
IndexArray = npt.NDArray[np.int64]
Progress = Callable[[int, int], None]
_Round = tuple[str, int, bool]

# Products beyond this are computed again for each row.
MOST_REMEMBERED_BYTES = 1 << 30


class DescribedViews:
    """Descriptors of views, the same for every split, and match features whose words a split's training views teach.

    mirror: descriptors of mirrored views too; turned: of turned copies (turned_views) of all. Words are learned without
    them. masked: leave out the depth around the object. Another sequence of images forgets everything.
    """

    def __init__(
        self, *, mirror: bool, masked: bool, turned: bool = False, n_words: int = 1000, seed: int = 0
    ) -> None:
        self.options = (mirror, masked, turned, n_words, seed)
        self._mirror = mirror
        self._masked = masked
        self._n_words = n_words
        self._seed = seed
        self._images: Sequence[RangeImage] | None = None
        # By kind, number of the turn (0: none), and whether mirrored.
        self._crops: dict[_Round, list[PatchDescriptors]] = {}
        self._turns = (0, *range(1, 1 + len(TURNS_DEG))) if turned else (0,)
        self._products: dict[tuple[str, bytes, bytes], tuple[Float32Array, Float32Array]] = {}

    def prepare(
        self, images: Sequence[RangeImage], kinds: Sequence[str], progress: Progress | None = None
    ) -> None:
        """Compute the descriptors that are not there; ``progress`` counts views over the kinds."""
        if images is not self._images:
            self._images = images
            self._crops.clear()
            self._products.clear()
        rounds = [
            (kind, turn, mirrored)
            for turn in self._turns
            for mirrored in (False, True)[: 1 + self._mirror]
            for kind in kinds
        ]
        missing = [key for key in rounds if key not in self._crops]
        described = [key for key in missing if not (key[2] and KINDS[key[0]].mirror_free)]
        for turn in self._turns:
            copies = images if turn == 0 else turned_copies(images, *TURNS_DEG[turn - 1])
            for mirrored in (False, True):
                shown = [mirrored_image(image) for image in copies] if mirrored else copies
                for key in [key for key in described if key[1:] == (turn, mirrored)]:

                    def report(done: int, _: int, before: int = described.index(key) * len(images)) -> None:
                        if progress is not None:
                            progress(before + done, len(described) * len(images))

                    self._crops[key] = describe_crops(shown, key[0], masked=self._masked, progress=report)
        for kind, turn, _ in set(missing) - set(described):
            self._crops[kind, turn, True] = [crop.mirrored() for crop in self._crops[kind, turn, False]]

    def features(self, kind: str, train: IndexArray, test: IndexArray) -> tuple[Float32Array, Float32Array]:
        """Power-transformed match features of training views and of test views.

        The mirror images of training views follow them, then each turned copy, with its mirror images, of all of them.
        """
        if (kind, 0, False) not in self._crops:
            raise DataError("kernel descriptors: expected prepare() to be called before views are compared")
        straight = self._crops[kind, 0, False]
        known = [straight[number] for number in train]
        vocabulary = learn_vocabulary(known, KINDS[kind].match_gamma, n_words=self._n_words, seed=self._seed)
        for turn in self._turns:
            for mirrored in (False, True)[turn == 0 : 1 + self._mirror]:
                known += [self._crops[kind, turn, mirrored][number] for number in train]
        asked = [straight[number] for number in test]
        return (
            power_transform(match_features(known, vocabulary)),
            power_transform(match_features(asked, vocabulary)),
        )

    def products(self, kind: str, train: IndexArray, test: IndexArray) -> tuple[Float32Array, Float32Array]:
        """Inner products of the features, remembered for the next row that asks for the same split."""
        key = (kind, train.tobytes(), test.tobytes())
        if key in self._products:
            return self._products[key]
        found = inner_products(*self.features(kind, train, test))
        for array in found:
            array.setflags(write=False)
        held = sum(array.nbytes for pair in self._products.values() for array in pair)
        if held + sum(array.nbytes for array in found) <= MOST_REMEMBERED_BYTES:
            self._products[key] = found
        return found


def inner_products(known: Float32Array, asked: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Products (n, n) among known rows and (m, n) of asked rows with them."""
    return gram_matrix(known), asked @ known.T
