"""The observation model: how likely a word is seen, or not, at a place with or without it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthprint.baselines.fabmap.chow_liu import ChowLiuTree
from depthprint.baselines.fabmap.settings import FabMapSettings

__all__ = ["log_seen_at_new_place", "log_seen_at_place", "word_states"]

FloatArray = npt.NDArray[np.float64]
Words = npt.NDArray[np.int32]


def log_seen_at_place(tree: ChowLiuTree, settings: FabMapSettings) -> FloatArray:
    """Table (k, 2, 2, 2) of log P(z_q | z_p, L): by the word, z_q, its parent's z_p, and whether L holds the word.

    Source: Cummins & Newman, IJRR 2008: the place's P(e|L) by the detector from one image, the word's P(z|e, z_p).
    """
    there_if_held, there_if_not = (_p_there(tree.p, settings, held) for held in (True, False))
    return np.log(np.stack([_seen(tree, settings, p) for p in (there_if_not, there_if_held)], axis=-1))


def log_seen_at_new_place(tree: ChowLiuTree, settings: FabMapSettings) -> FloatArray:
    """Table (k, 2, 2) of log P(z_q | z_p) at the average place: the mean field, where P(e|L) is P(e)."""
    return np.log(_seen(tree, settings, tree.p))


def word_states(words: Words, tree: ChowLiuTree) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """(k,) 0 or 1 for every word of an image, and for every word's parent; a root's parent counts as not seen."""
    seen = np.zeros(len(tree), dtype=np.intp)
    seen[words] = 1
    root = tree.parent == np.arange(len(tree))
    return seen, np.where(root, 0, seen[tree.parent])


def _p_there(p: FloatArray, settings: FabMapSettings, held: bool) -> FloatArray:
    """P(e=1|L) of a place whose one image held the word, or did not."""
    seen, wrong = settings.p_seen_if_there, settings.p_seen_if_not
    if not held:
        seen, wrong = 1 - seen, 1 - wrong
    return seen * p / (seen * p + wrong * (1 - p))


def _seen(tree: ChowLiuTree, settings: FabMapSettings, p_there: FloatArray) -> FloatArray:
    """P(z_q|z_p) (k, 2, 2) at a place that has each word's thing with probability ``p_there``."""
    table = np.empty((len(tree), 2, 2))
    for parent_state, given in enumerate((tree.p_given_none, tree.p_given_parent)):
        p_seen = np.zeros(len(tree))
        for there, weight in ((True, p_there), (False, 1 - p_there)):
            by_detector = settings.p_seen_if_there if there else settings.p_seen_if_not
            if settings.tree:
                no = tree.p * (1 - by_detector) * (1 - given)
                yes = (1 - tree.p) * by_detector * given
                p_seen += weight * yes / (yes + no)
            else:
                p_seen += weight * by_detector
        table[:, 1, parent_state] = p_seen
        table[:, 0, parent_state] = 1 - p_seen
    return table
