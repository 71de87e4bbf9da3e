"""A recogniser of a user's own objects or kinds of places: learned from labelled views, saved, asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoder_ablations import suited_encoder
from depthprint.errors import DataError
from depthprint.object_surface import object_surface
from depthprint.objects.alignment import AGREEMENT_WEIGHT, aligned_agreements, checked_scores
from depthprint.objects.calibration import Calibration, calibrate
from depthprint.objects.learned_classes import LearnedClasses
from depthprint.objects.recogniser_file import RecogniserParts, load_recogniser, save_recogniser
from depthprint.objects.stored_geometry import StoredGeometry
from depthprint.objects.stored_views import StoredViews, describe_and_store
from depthprint.range_image import RangeImage

if TYPE_CHECKING:
    from depthprint._kernels.surface_alignment import SeenSurface

__all__ = ["Recognition", "TrainedRecogniser", "left_out_scores"]

Progress = Callable[[int, int], None]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_ASKED_AT_ONCE = 256


@dataclass(frozen=True)
class Recognition:
    """What a query was recognised as.

    label: the most probable class, or None where none of the known ones is more probable than not.
    confidence: probability of ``label``, or of none of the classes where it is None.
    classes: every class with its probability, most probable first; with ``none_probability`` they add up to 1.
    nearest: name of the stored view nearest to the query.
    """

    label: str | None
    confidence: float
    classes: tuple[tuple[str, float], ...]
    none_probability: float
    nearest: str


class TrainedRecogniser:
    """Name the class of one view, or of several views of one object, with a confidence, or none of the classes.

    The fused recogniser over short vectors: the leading directions of the pooled codes, for objects those of their
    surfaces too, and the information distance to a few landmarks, so that a query solves few EMDs whatever was stored.
    Of objects, the best few classes are checked by aligning the query with their likest views.
    """

    def __init__(
        self,
        encoder: Encoder,
        stored: StoredViews,
        labels: Sequence[str],
        sources: Sequence[str],
        calibration: Calibration,
        learned: LearnedClasses | None = None,
    ) -> None:
        self.encoder = encoder
        self.stored = stored
        self.view_labels = tuple(labels)
        self.sources = tuple(sources)
        self.calibration = calibration
        self.learned = LearnedClasses.fit(stored.views, labels) if learned is None else learned
        self._classes = np.searchsorted(self.learned.labels, np.asarray(labels))

    @classmethod
    def fit(
        cls,
        encoder: Encoder,
        images: Sequence[RangeImage],
        labels: Sequence[str],
        *,
        groups: Sequence[str] | None = None,
        sources: Sequence[str] | None = None,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> TrainedRecogniser:
        """Learn from views (n) and the class of each.

        groups: which object each view shows, None: each view its own; confidence is learned on objects left out.
        sources: names of the views, by which the nearest one is told. Raises DataError for lists of unequal length or
        fewer than two classes, and as the encoder does.
        """
        names = [image.source or str(k) for k, image in enumerate(images)] if sources is None else sources
        objects = [str(k) for k in range(len(images))] if groups is None else groups
        if not len(images) == len(labels) == len(objects) == len(names):
            raise DataError(
                f"recogniser: expected a label, group and source for each of {len(images)} views, "
                f"got {len(labels)}, {len(objects)} and {len(names)}"
            )
        if len(set(labels)) < 2:
            raise DataError(f"recogniser: expected views of two classes or more, got {sorted(set(labels))}")
        encoder = suited_encoder(encoder, images[0])
        stored = describe_and_store(encoder, images, seed, progress)
        calibration = calibrate(
            lambda train, known, test: left_out_scores(stored, images, train, known, test)[::2],
            np.asarray(labels),
            np.asarray(objects),
            seed,
        )
        return cls(encoder, stored, labels, names, calibration)

    @property
    def labels(self) -> tuple[str, ...]:
        """The classes, sorted."""
        return tuple(str(label) for label in self.learned.labels)

    def recognise(self, views: RangeImage | Sequence[RangeImage]) -> Recognition:
        """Recognise one view, or several views of one object; their scores are averaged."""
        from depthprint._kernels.blocks import one_blas_thread

        images = [views] if isinstance(views, RangeImage) else list(views)
        if not images:
            raise DataError("recognise: expected a view or several of one object, got none")
        with one_blas_thread():
            return self._recognised(images)

    def _recognised(self, images: Sequence[RangeImage]) -> Recognition:
        features, seen = self.stored.encode_and_describe(self.encoder, images)
        near, labels = features.distances_to(self.stored.views), self.labels
        distances = near[0]
        scores = _checked(
            self.learned.scores(features, near),
            np.arange(len(labels)),
            self.stored.geometry,
            seen.__getitem__,
            self._classes,
            _nearness(near, len(self.sources)),
        ).mean(axis=0)
        shares, none = self.calibration.probabilities(scores, float(distances.min(axis=1).mean()))
        order = np.argsort(-shares, kind="stable")
        nearest = int(distances.min(axis=0).argmin())
        best = int(order[0])
        known = none <= 0.5
        return Recognition(
            label=labels[best] if known else None,
            confidence=float(shares[best]) if known else none,
            classes=tuple((labels[k], float(shares[k])) for k in order),
            none_probability=none,
            nearest=self.sources[nearest],
        )

    def predict(self, queries: Sequence[RangeImage | Sequence[RangeImage]]) -> list[str | None]:
        """Label of each query, None for none of the classes; a query is a view or several views of one object."""
        return [self.recognise(query).label for query in queries]

    def save(self, path: Path | str) -> Path:
        """Write one file, without pickle; it appears whole or not at all."""
        parts = RecogniserParts(
            self.encoder, self.stored, self.view_labels, self.sources, self.calibration, self.learned
        )
        return save_recogniser(parts, Path(path))

    @classmethod
    def load(cls, path: Path | str) -> TrainedRecogniser:
        """Read a recogniser; a damaged file, or one of another kind or version, raises ModelError naming it."""
        return cls(*load_recogniser(Path(path)))


def left_out_scores(
    kept: StoredViews, images: Sequence[RangeImage], train: IntArray, labels: npt.NDArray[Any], test: IntArray
) -> tuple[FloatArray, npt.NDArray[Any], FloatArray]:
    """What a recogniser of some of the kept views says of others of them; numbers are those of views and ``images``.

    labels: of the views ``train``. Returns scores (m, c) of the views ``test``, the labels (c,) of their columns, and
    the distances (m,) to the nearest stored view by codes.
    """
    stored = kept.views.taken(train)
    learned = LearnedClasses.fit(stored, labels)
    scores, nearest = [], []
    for start in range(0, len(test), _ASKED_AT_ONCE):
        block = test[start : start + _ASKED_AT_ONCE]
        asked = kept.views.taken(block)
        near = asked.distances_to(stored)
        found = _checked(
            learned.scores(asked, near),
            learned.labels,
            kept.geometry,
            partial(_surface_of, images, block),
            labels,
            _nearness(near, len(train)),
            train,
        )
        scores.append(found)
        nearest.append(near[0].min(axis=1).astype(np.float64))
    return np.concatenate(scores), learned.labels, np.concatenate(nearest)


def _surface_of(images: Sequence[RangeImage], numbers: IntArray, query: int) -> SeenSurface:
    return object_surface(images[numbers[query]])


def _nearness(
    distances: Sequence[npt.NDArray[np.floating[Any]]], n_views: int
) -> npt.NDArray[np.floating[Any]]:
    """Likeness (m, n) of the stored views by their surfaces, by their codes where these alone are compared."""
    return -distances[min(1, len(distances) - 1)][:, :n_views]


def _checked(
    scores: FloatArray,
    labels: npt.NDArray[Any],
    geometry: StoredGeometry | None,
    seen: Callable[[int], SeenSurface],
    view_labels: npt.NDArray[Any],
    nearness: npt.NDArray[np.floating[Any]],
    numbers: IntArray | None = None,
) -> FloatArray:
    """Scores (m, c) with what the alignment of what is ``seen`` of each query says.

    numbers: of the stored views in ``geometry``, None: as they are.
    """
    if geometry is None:
        return scores

    def agreements_with(query: int, views: IntArray) -> FloatArray:
        kept = [geometry.surface(int(k)) for k in (views if numbers is None else numbers[views])]
        return aligned_agreements(seen(query), kept)

    return checked_scores(scores, labels, view_labels, nearness, agreements_with, AGREEMENT_WEIGHT)
