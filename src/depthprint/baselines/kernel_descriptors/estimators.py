"""Kernel descriptors as scikit-learn estimators: crops in, match features out, and a classifier of crops."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.pipeline import FeatureUnion, Pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils.validation import check_is_fitted

from depthprint.baselines.kernel_descriptors.kinds import KINDS, describe_crops, descriptor_kind
from depthprint.baselines.kernel_descriptors.match_features import (
    Vocabulary,
    learn_vocabulary,
    match_features,
    power_transform,
)
from depthprint.baselines.linear_svm import LinearSvm
from depthprint.range_image import RangeImage

__all__ = ["KernelDescriptorFeatures", "kernel_descriptor_classifier"]

Float32Array = npt.NDArray[np.float32]
Progress = Callable[[int, int], None]


class KernelDescriptorFeatures(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """RangeImages -> match features (n, 14 n_words) float32 of one kernel descriptor.

    kind: 'gradient', 'lbp', 'spin' or 'size'. n_words: visual words, learned by ``fit`` from its images alone; fewer
    where these have fewer different descriptors. masked: leave out the depth around the object.
    progress: called with (images described, images in all).
    Images are pinhole crops in metres. Raises as describe_crops and learn_vocabulary do.
    Source: Bo, Ren and Fox, NIPS 2010 and IROS 2011.
    """

    def __init__(
        self,
        kind: str = "gradient",
        *,
        n_words: int = 1000,
        masked: bool = False,
        random_state: int = 0,
        progress: Progress | None = None,
    ) -> None:
        self.kind = kind
        self.n_words = n_words
        self.masked = masked
        self.random_state = random_state
        self.progress = progress

    def fit(self, X: Sequence[RangeImage], y: Any = None) -> KernelDescriptorFeatures:
        """Learn the words."""
        self.fit_transform(X, y)
        return self

    def fit_transform(self, X: Sequence[RangeImage], y: Any = None, **fit_params: Any) -> Float32Array:
        """Learn the words and describe the same images, reading each once."""
        crops = describe_crops(X, self.kind, masked=self.masked, progress=self.progress)
        gamma = descriptor_kind(self.kind).match_gamma
        self.vocabulary_: Vocabulary = learn_vocabulary(
            crops, gamma, n_words=self.n_words, seed=self.random_state
        )
        return match_features(crops, self.vocabulary_)

    def transform(self, X: Sequence[RangeImage]) -> Float32Array:
        """Describe images by the words learned."""
        check_is_fitted(self, "vocabulary_")
        crops = describe_crops(X, self.kind, masked=self.masked, progress=self.progress)
        return match_features(crops, self.vocabulary_)


def kernel_descriptor_classifier(
    kinds: Sequence[str] = tuple(KINDS),
    *,
    C: float = 10.0,
    n_words: int = 1000,
    masked: bool = False,
    random_state: int = 0,
    progress: Progress | None = None,
) -> Pipeline:
    """Pipeline of crops to classes: features of the kinds side by side, power transform, linear machine.

    Raises SettingsError for an unknown kind.
    """
    options: dict[str, Any] = {
        "n_words": n_words,
        "masked": masked,
        "random_state": random_state,
        "progress": progress,
    }
    for kind in kinds:
        descriptor_kind(kind)
    return Pipeline(
        [
            ("features", FeatureUnion([(kind, KernelDescriptorFeatures(kind, **options)) for kind in kinds])),
            ("power", FunctionTransformer(power_transform)),
            ("svm", LinearSvm(C, random_state=random_state)),
        ]
    )
