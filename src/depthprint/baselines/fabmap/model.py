"""A trained FAB-MAP model: words, their tree, and what the training images showed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from depthprint.baselines.fabmap.chow_liu import ChowLiuTree, learn_chow_liu_tree
from depthprint.baselines.fabmap.clustering import nearest_centres, sequential_clusters
from depthprint.baselines.fabmap.features import SiftFeatures
from depthprint.baselines.fabmap.settings import FabMapSettings
from depthprint.errors import DataError

__all__ = ["FabMapModel", "train_fabmap", "words_of"]

Words = npt.NDArray[np.int32]
Picture = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class FabMapModel:
    """What is learned before a drive.

    centres: (k, 128) float32, the vocabulary. tree: of its k words. training: the words of each training image,
    from which the new place is sampled. Raises DataError where these do not fit each other.
    """

    settings: FabMapSettings
    centres: npt.NDArray[np.float32]
    tree: ChowLiuTree
    training: tuple[Words, ...]
    _features: SiftFeatures = field(init=False, repr=False)

    def __post_init__(self) -> None:
        centres = np.array(self.centres, dtype=np.float32)
        if centres.ndim != 2 or len(centres) != len(self.tree):
            raise DataError(
                f"FabMapModel: expected a vocabulary of {len(self.tree)} words, as its tree, got {centres.shape}"
            )
        if not self.training:
            raise DataError("FabMapModel: expected the words of at least one training image, got none")
        for words in self.training:
            if (
                words.ndim != 1
                or (np.diff(words) <= 0).any()
                or (words < 0).any()
                or (words >= len(centres)).any()
            ):
                raise DataError(
                    "FabMapModel: expected sorted, distinct words of the vocabulary in each image"
                )
        centres.setflags(write=False)
        object.__setattr__(self, "centres", centres)
        object.__setattr__(self, "_features", _features_of(self.settings))

    def words(self, picture: Picture) -> Words:
        """Words seen in a grey (height, width) uint8 image: sorted, distinct, int32; each feature's nearest centre."""
        return words_of(self._features(picture), self.centres)


def words_of(descriptors: npt.NDArray[np.float32], centres: npt.NDArray[np.float32]) -> Words:
    """Sorted, distinct indices of the centres nearest to descriptors (n, d)."""
    return np.unique(nearest_centres(descriptors, centres)).astype(np.int32)


def train_fabmap(
    pictures: Sequence[Picture],
    settings: FabMapSettings | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> FabMapModel:
    """Learn vocabulary and tree from grey uint8 images that are scored nowhere.

    ``progress`` counts the descriptors clustered. Raises DataError where no image shows a feature.
    """
    chosen = FabMapSettings() if settings is None else settings
    features = _features_of(chosen)
    described = [features(picture) for picture in pictures]
    if not any(len(d) for d in described):
        raise DataError(f"FAB-MAP: none of {len(described)} training images shows a single SIFT feature")
    centres = sequential_clusters(np.concatenate(described), chosen.cluster_size, progress)
    training = tuple(words_of(d, centres) for d in described)
    tree = learn_chow_liu_tree(training, len(centres), chosen.information_bound)
    return FabMapModel(chosen, centres, tree, training)


def _features_of(settings: FabMapSettings) -> SiftFeatures:
    return SiftFeatures(settings.n_features, upright=settings.upright, contrast=settings.contrast)
