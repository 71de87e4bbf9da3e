"""The recogniser as users train and save it, in the table of methods that name objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoder_ablations import suited_encoder
from depthprint.errors import DataError
from depthprint.objects.stored_views import StoredViews, describe_and_store
from depthprint.objects.trained_recogniser import left_out_scores
from depthprint.range_image import RangeImage

__all__ = ["SavedRecogniserMethod"]

Progress = Callable[[int, int], None]
IndexArray = npt.NDArray[np.int64]


class SavedRecogniserMethod:
    """``TrainedRecogniser`` on views of a protocol: short vectors, few EMDs a view, and no matrix of all pairs.

    Leading directions and landmarks are those of all views, which are given without labels.
    """

    def __init__(self, name: str, encoder: Encoder) -> None:
        self.name = name
        self.us_per_pair = float("nan")
        self._encoder = encoder
        self._images: Sequence[RangeImage] = ()
        self._kept: StoredViews | None = None

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Describe the views; nothing happens for those that were given last."""
        if images is self._images:
            return
        encoder = suited_encoder(self._encoder, images[0])
        self._kept = describe_and_store(encoder, images, encoder.settings.seed, progress)
        self._images = images

    def predict(self, train: IndexArray, train_labels: IndexArray, test: IndexArray) -> IndexArray:
        """Label of the highest score, for each test view."""
        scores, labels = self.scores(train, train_labels, test)
        return np.asarray(labels[scores.argmax(axis=1)])

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[npt.NDArray[np.float64], IndexArray]:
        """Scores (n_test, n_labels), larger is better, and the labels of their columns."""
        if self._kept is None:
            raise DataError(f"method {self.name!r}: expected prepare() to be called first")
        scores, labels, _ = left_out_scores(self._kept, self._images, train, train_labels, test)
        return scores, labels
