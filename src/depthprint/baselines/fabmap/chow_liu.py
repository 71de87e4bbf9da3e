"""Chow-Liu tree: which word depends on which, learned from the words of training images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError

__all__ = ["ChowLiuTree", "learn_chow_liu_tree", "mutual_information"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]


@dataclass(frozen=True)
class ChowLiuTree:
    """P(z) as a product over words, each given its parent; all arrays (k,), read-only.

    parent: int32, the word that each depends on; the root is its own parent.
    p: P(z=1). p_given_parent, p_given_none: P(z=1|parent seen), P(z=1|parent not seen); the root's are P(z=1).

    Raises DataError where a parent is no word, or a probability outside (0, 1).
    """

    parent: npt.NDArray[np.int32]
    p: FloatArray
    p_given_parent: FloatArray
    p_given_none: FloatArray

    def __post_init__(self) -> None:
        for name in ("parent", "p", "p_given_parent", "p_given_none"):
            array: npt.NDArray[Any] = np.array(
                getattr(self, name), dtype=np.int32 if name == "parent" else np.float64
            )
            if array.shape != np.shape(self.p) or array.ndim != 1:
                raise DataError(
                    f"ChowLiuTree: expected {name} of shape {np.shape(self.p)}, got {array.shape}"
                )
            good = (array >= 0) & (array < len(array)) if name == "parent" else (array > 0) & (array < 1)
            if not good.all():
                word = int(np.argmin(good))
                raise DataError(f"ChowLiuTree: word {word} has the impossible {name} {array[word]}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.p)


def learn_chow_liu_tree(
    images: Sequence[IntArray], n_words: int, information_bound: float = 0.0005
) -> ChowLiuTree:
    """Learn the tree from the words (sorted, distinct) seen in each training image.

    P(z) = 0.98 n/N + 0.01, P(z|zp) = 0.98 c/t + 0.01 where the parent took its value t times and the word was seen in
    c of them. Edges are pairs with mutual information of at least ``information_bound`` nats; the tree is the
    spanning tree of most information, and what it does not reach hangs from its root.
    Raises DataError without images.

    Source: Chow & Liu 1968, as used by Cummins & Newman, IJRR 2008.
    """
    if not len(images):
        raise DataError("learn_chow_liu_tree: expected at least one training image, got none")
    seen = _incidence(images, n_words)
    count = np.asarray(seen.sum(axis=0), dtype=np.float64).ravel()
    parent, joint = _spanning_tree(seen, count, len(images), information_bound)
    p = _smoothed(count, np.full(n_words, float(len(images))))
    given_parent = _smoothed(joint, count[parent])
    given_none = _smoothed(count - joint, len(images) - count[parent])
    root = parent == np.arange(n_words)
    return ChowLiuTree(parent, p, np.where(root, p, given_parent), np.where(root, p, given_none))


def mutual_information(
    count_a: FloatArray | float, count_b: FloatArray, together: FloatArray, n: int
) -> FloatArray:
    """Mutual information, in nats, of words seen in ``count_a`` and ``count_b`` of n images, ``together`` in both.

    Unsmoothed joints over smoothed marginals, which keeps the logarithm finite.
    """
    p_a, p_b = 0.98 * np.asarray(count_a) / n + 0.01, 0.98 * count_b / n + 0.01
    total = np.zeros_like(count_b)
    cells = (
        (together, p_a, p_b),
        (count_a - together, p_a, 1 - p_b),
        (count_b - together, 1 - p_a, p_b),
        (n - count_a - count_b + together, 1 - p_a, 1 - p_b),
    )
    for joint_count, first, second in cells:
        joint = joint_count / n
        inside = joint > 0
        ratio = np.divide(joint, first * second, out=np.ones_like(total), where=inside)
        total += joint * np.log(ratio)
    return total


def _smoothed(hits: FloatArray, trials: FloatArray) -> FloatArray:
    return np.asarray(0.98 * np.divide(hits, trials, out=np.zeros_like(hits), where=trials > 0) + 0.01)


def _incidence(images: Sequence[IntArray], n_words: int) -> Any:
    from scipy.sparse import csr_matrix

    columns = np.concatenate([np.asarray(words, dtype=np.int64) for words in images])
    ends = np.cumsum([0] + [len(words) for words in images])
    return csr_matrix((np.ones(len(columns), dtype=np.float32), columns, ends), shape=(len(images), n_words))


def _spanning_tree(seen: Any, count: FloatArray, n: int, bound: float) -> tuple[IntArray, FloatArray]:
    """Parent of each word on the tree of most information, and in how many images it was seen with that parent.

    Prim's algorithm, which needs one row of the matrix of informations at a time. The word seen most often is the root.
    """
    by_word = seen.T.tocsr()
    k = len(count)
    root = int(np.argmax(count))
    parent = np.full(k, root, dtype=np.int32)
    most, joint = np.full(k, -np.inf), np.zeros(k)
    outside = np.ones(k, dtype=bool)
    word = root
    while True:
        outside[word] = False
        together = np.asarray((by_word[word] @ seen).todense(), dtype=np.float64).ravel()
        information = mutual_information(count[word], count, together, n)
        # below the bound a word hangs from the root, whatever it shares with others
        if word != root:
            information[information < bound] = -np.inf
        nearer = outside & (information > most)
        most[nearer], joint[nearer], parent[nearer] = information[nearer], together[nearer], word
        if not outside.any():
            return parent, joint
        word = int(np.argmax(np.where(outside, most, -np.inf)))
