"""The index of FAB-MAP 2.0: places' log-likelihoods by visiting only those that hold a word that matters."""

from __future__ import annotations

from array import array

import numpy as np
import numpy.typing as npt

from depthprint.baselines.fabmap.chow_liu import ChowLiuTree
from depthprint.baselines.fabmap.observation import log_seen_at_place
from depthprint.baselines.fabmap.settings import FabMapSettings

__all__ = ["LikelihoodIndex"]

FloatArray = npt.NDArray[np.float64]
Words = npt.NDArray[np.int32]


class LikelihoodIndex:
    """Places by the words that they hold.

    Each word q has four weights: what a place gains by holding q, as against not holding it, by what the image shows
    of q and of its parent: d1 neither, d2 the parent alone, d3 the word alone, d4 both. A place starts with the sum
    of d1 over its words; an image then changes only the words that it shows and their children.

    Source: Cummins & Newman, "Appearance-only SLAM at large scale with FAB-MAP 2.0", IJRR 2011, section 4.
    """

    def __init__(self, tree: ChowLiuTree, settings: FabMapSettings) -> None:
        table = log_seen_at_place(tree, settings)
        gain = table[..., 1] - table[..., 0]
        self._d1 = gain[:, 0, 0]
        self._beyond_d1 = gain - gain[:, :1, :1]  # by z_q and z_p: 0, d2 - d1; d3 - d1, d4 - d1
        absent = table[..., 0]
        self._nowhere = float(absent[:, 0, 0].sum())
        self._absent_beyond = absent - absent[:, :1, :1]
        words = np.arange(len(tree))
        is_child = tree.parent != words
        self._is_child = is_child
        self._parent = tree.parent
        by_parent = np.argsort(np.where(is_child, tree.parent, len(tree)), kind="stable")
        counts = np.bincount(tree.parent[is_child], minlength=len(tree))
        self._children = np.split(by_parent[: counts.sum()], np.cumsum(counts)[:-1])
        self._postings = [array("i") for _ in words]
        self._defaults = array("d")

    def __len__(self) -> int:
        return len(self._defaults)

    def add(self, words: Words) -> int:
        """Store a place by the words (sorted, distinct) of its image, and return its number."""
        place = len(self._defaults)
        for word in words.tolist():
            self._postings[word].append(place)
        self._defaults.append(float(self._d1[words].sum()))
        return place

    def log_likelihoods(self, words: Words, limit: int | None = None) -> FloatArray:
        """Log P(Z|L) of an image's words at the places below ``limit`` (all when None), equal to FAB-MAP 1's."""
        n = len(self) if limit is None else max(0, min(limit, len(self)))
        seen = np.zeros(len(self._d1), dtype=bool)
        seen[words] = True
        children = np.concatenate([self._children[word] for word in words.tolist()] or [[]]).astype(np.intp)
        children = children[~seen[children]]
        parent_seen = (seen[self._parent[words]] & self._is_child[words]).astype(np.intp)
        changed = np.concatenate([words, children]).astype(np.intp)
        gains = np.concatenate([self._beyond_d1[words, 1, parent_seen], self._beyond_d1[children, 0, 1]])
        everywhere = (
            self._nowhere
            + self._absent_beyond[words, 1, parent_seen].sum()
            + self._absent_beyond[children, 0, 1].sum()
        )
        totals = np.frombuffer(self._defaults, dtype=np.float64, count=n).copy() if n else np.empty(0)
        totals += everywhere
        postings = [self._postings[word] for word in changed.tolist()]
        places = np.frombuffer(b"".join(map(bytes, postings)), dtype=np.int32)
        gained = np.repeat(gains, [len(posting) for posting in postings])
        return totals + np.bincount(places, gained, minlength=n)[:n]
