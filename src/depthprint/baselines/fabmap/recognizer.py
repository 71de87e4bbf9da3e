"""FAB-MAP 2.0 as a place recogniser on depth: pictures of depth, words, and the odds of the belief."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from depthprint.baselines.fabmap.belief import Belief, FabMap
from depthprint.baselines.fabmap.depth_picture import DepthPicture
from depthprint.baselines.fabmap.model import FabMapModel, train_fabmap
from depthprint.baselines.fabmap.posterior import log_odds_against
from depthprint.baselines.vector_store import nearest_matches
from depthprint.errors import ModelError
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch

__all__ = ["FabMapRecognizer"]

Words = npt.NDArray[np.int32]


class FabMapRecognizer:
    """Log odds against each place, the place never visited among the outcomes: negative where it is the likelier.

    They rank as the probability does, and still tell sure matches apart where that rounds to one.

    The motion prior follows the drive: when the description that was last queried is added, its belief becomes the
    earlier one of the next query. Between additions a query changes nothing.
    """

    def __init__(self, model: FabMapModel, picture: DepthPicture | None = None) -> None:
        self._picture = DepthPicture() if picture is None else picture
        self._model = model
        self._map = FabMap(model)
        self._latest: tuple[Words, Belief] | None = None

    def fit(self, images: Sequence[RangeImage]) -> FabMapRecognizer:
        """Learn vocabulary and tree from frames that are scored nowhere, and forget all places."""
        if not len(images):
            raise ModelError("FAB-MAP: expected frames to learn from, got none")
        self._model = train_fabmap([self._picture(image) for image in images], self._model.settings)
        self._map, self._latest = FabMap(self._model), None
        return self

    def describe(self, image: RangeImage) -> Words:
        """Words seen in one frame: sorted, distinct, int32."""
        return self._model.words(self._picture(image))

    def add(self, description: Words) -> int:
        """Store a place."""
        if self._latest is not None and self._latest[0] is description:
            self._map.follow(self._latest[1])
        self._latest = None
        return self._map.add(description)

    def query(self, description: Words, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        """Most probable places below ``limit``, with their neighbours where the settings say so."""
        belief = self._map.locate(description, limit)
        self._latest = (description, belief)
        return nearest_matches(
            log_odds_against(belief.log_new, belief.log_places, self._model.settings.neighbours), k
        )

    def distance(self, first: Words, second: Words) -> float:
        """Log odds against ``first`` being at the place of ``second``, were that the whole map."""
        alone = FabMap(self._model)
        alone.add(second)
        belief = alone.locate(first)
        return float(log_odds_against(belief.log_new, belief.log_places)[0])
