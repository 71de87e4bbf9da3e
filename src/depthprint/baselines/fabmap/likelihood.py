"""The likelihood of FAB-MAP 1: every word at every place. Exact, slow, and what the index must equal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.baselines.fabmap.chow_liu import ChowLiuTree
from depthprint.baselines.fabmap.observation import log_seen_at_place, word_states
from depthprint.baselines.fabmap.settings import FabMapSettings

__all__ = ["full_log_likelihoods"]


def full_log_likelihoods(
    words: npt.NDArray[np.int32],
    places: Sequence[npt.NDArray[np.int32]],
    tree: ChowLiuTree,
    settings: FabMapSettings,
) -> npt.NDArray[np.float64]:
    """Log P(Z|L) (n,) of an image's words (sorted, distinct) at each place, given by the words of its image.

    Source: Cummins & Newman, IJRR 2008: the sum over all words of log P(z_q | z_p, L).
    """
    table = log_seen_at_place(tree, settings)
    seen, parent_seen = word_states(words, tree)
    of_words = table[np.arange(len(tree)), seen, parent_seen]
    totals = np.empty(len(places))
    for number, held in enumerate(places):
        holds = np.zeros(len(tree), dtype=np.intp)
        holds[held] = 1
        totals[number] = of_words[np.arange(len(tree)), holds].sum()
    return totals
