"""Our object methods for the protocols: nearest by information distance, its kernel machine, and the recogniser."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from depthprint.classification import NearestComplexityClassifier
from depthprint.errors import DataError, SettingsError
from depthprint.objects.comparisons import ObjectComparisons
from depthprint.objects.distances import MirroredDistances
from depthprint.objects.fused_recogniser import (
    KERNEL_SHARES,
    FusedRecogniser,
    ViewComparison,
    fused_comparison,
    nearest_weights,
)
from depthprint.objects.kernels import DistanceFeatures
from depthprint.objects.surface_comparisons import PARTIAL, TURNED, VIEWS, SurfaceKernels
from depthprint.range_image import RangeImage

__all__ = ["ALL_PARTS", "EncodedMethod", "EncodedNearest", "EncodedRecogniser", "EncodedSVM"]

Progress = Callable[[int, int], None]
IndexArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

# More landmarks than this make the eigenvectors dearer than the distances.
MAX_LANDMARKS = 1500
_SVM_COST = 10.0
_KINDS_OF_PARTS = {
    "codes": ("code_kernel", "pictures"),
    "complexities": ("complexities",),
    "surfaces": ("surfaces",),
    "sizeless": ("sizeless",),
    "pairs": ("pairs",),
    "turned": ("turned",),
}
ALL_PARTS = ("codes", "complexities", "surfaces", "pairs")
_ROWS_PER_CALL = 256


class EncodedMethod:
    """A method over what ``comparisons`` holds; methods may share one, and each kind is then computed once."""

    def __init__(self, name: str, comparisons: ObjectComparisons, kinds: Sequence[str]) -> None:
        self.name = name
        self.comparisons = comparisons
        self.us_per_pair = float("nan")
        self._kinds = tuple(kinds)

    def prepare(self, images: Sequence[RangeImage], progress: Progress | None = None) -> None:
        """Encode the views and compare them all."""
        self.comparisons.prepare(images, progress)
        for kind in self._kinds:
            getattr(self.comparisons, kind)()
        seconds = sum(self.comparisons.seconds[kind] for kind in self._kinds)
        self.us_per_pair = seconds * 1e6 / max(1, len(images) * (len(images) - 1) // 2)

    @property
    def bytes_per_pair(self) -> float:
        """Memory at its peak over the square of the number of views: distances both ways, a kernel, and copies."""
        return 60.0

    def predict(self, train: IndexArray, train_labels: IndexArray, test: IndexArray) -> IndexArray:
        """Label of the highest score, for each test view."""
        scores, labels = self.scores(train, train_labels, test)
        return np.asarray(labels[scores.argmax(axis=1)])

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[FloatArray, IndexArray]:
        """Scores (n_test, n_labels), larger is better, and the labels of their columns."""
        raise NotImplementedError


class EncodedNearest(EncodedMethod):
    """Nearest stored view, distances scaled locally."""

    def __init__(
        self,
        name: str,
        comparisons: ObjectComparisons,
        kind: str,
        local_scaling: int,
    ) -> None:
        super().__init__(name, comparisons, [kind])
        self._local_scaling = local_scaling

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[FloatArray, IndexArray]:
        """Negated distance to the nearest training view of each label."""
        distances = self._distances()
        classifier = NearestComplexityClassifier(local_scaling=self._local_scaling)
        classifier.fit(distances[np.ix_(train, train)], train_labels)
        return -classifier.nearest_by_class(distances[np.ix_(test, train)]), classifier.classes_

    def neighbours(self, train: IndexArray, test: IndexArray, k: int) -> IndexArray:
        """Numbers (n_test, k) of the nearest training views, nearest first."""
        distances = self._distances()
        classifier = NearestComplexityClassifier(local_scaling=self._local_scaling)
        classifier.fit(distances[np.ix_(train, train)], np.zeros(len(train), dtype=np.int64))
        return train[classifier.kneighbors(distances[np.ix_(test, train)], k)[1]]

    def _distances(self) -> FloatArray:
        found = getattr(self.comparisons, self._kinds[0])()
        return found.nearer() if isinstance(found, MirroredDistances) else found


class EncodedSVM(EncodedMethod):
    """Support vector machine, one against one, on the kernel of the information distance.

    Scores are votes, and between equal votes the sum of margins: they add up over views.
    """

    def __init__(self, name: str, comparisons: ObjectComparisons) -> None:
        super().__init__(name, comparisons, ["complexities"])

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[FloatArray, IndexArray]:
        """Votes of the pairwise machines, with their margins as fractions of a vote."""
        from sklearn.svm import SVC

        learned, asked = distance_features(self.comparisons.complexities(), train, test)
        machine = SVC(C=_SVM_COST, kernel="precomputed", decision_function_shape="ovr")
        machine.fit(learned @ learned.T, train_labels)
        kernel = asked @ learned.T
        parts = [
            machine.decision_function(kernel[start : start + _ROWS_PER_CALL])
            for start in range(0, len(kernel), _ROWS_PER_CALL)
        ]
        scores = np.concatenate(parts)
        if scores.ndim == 1:
            scores = np.stack([-scores, scores], axis=1)
        return scores, machine.classes_


class EncodedRecogniser(EncodedMethod):
    """The recogniser that ships: a discriminant over four kernels, a machine over surfaces, and nearest views.

    The kernels are of the pooled codes, of the information distance, of the surfaces and of their pairs of points, the
    machine's of the latter two. ``parts`` names what is used, of 'codes', 'complexities', 'surfaces', 'sizeless'
    (surfaces without the size kind), 'turned' (surfaces of which discriminant, machine and neighbours know copies
    turned up and down; not beside 'pairs') or 'pairs': what each adds. With
    ``partial`` the discriminant and the neighbours know partly hidden copies of the training views too.
    """

    def __init__(
        self,
        name: str,
        comparisons: ObjectComparisons,
        *,
        parts: Sequence[str] = ALL_PARTS,
        partial: bool = True,
    ) -> None:
        unknown = sorted(set(parts) - set(_KINDS_OF_PARTS))
        if unknown or not parts:
            raise SettingsError(f"method {name!r}: expected parts of {list(_KINDS_OF_PARTS)}, got {unknown}")
        super().__init__(name, comparisons, [kind for part in parts for kind in _KINDS_OF_PARTS[part]])
        self._parts = tuple(parts)
        self._machine_copies = (VIEWS, *(TURNED if "turned" in parts else ()))
        self._copies = (*self._machine_copies, *((PARTIAL,) if partial else ()))

    @property
    def bytes_per_pair(self) -> float:
        """The same, as measured with all parts, from 1836 views on to 2754."""
        return 440.0

    def scores(
        self, train: IndexArray, train_labels: IndexArray, test: IndexArray
    ) -> tuple[FloatArray, IndexArray]:
        """Scores of the fused recogniser."""
        if not len(train) or not len(test):
            raise DataError(f"method {self.name!r}: expected views to train on and to test, got none")
        stored, asked = [], []
        for part in self._parts:
            stored.append(self._compared(part, train, train))
            asked.append(self._compared(part, test, train))
        shares = [KERNEL_SHARES[part] for part in self._parts]
        recogniser = FusedRecogniser(nearest_weights=nearest_weights(self._parts))
        recogniser.fit(fused_comparison(stored, shares), train_labels)
        return recogniser.scores(fused_comparison(asked, shares)), recogniser.labels

    def likeness(self, train: IndexArray, test: IndexArray) -> npt.NDArray[np.float32]:
        """Likeness (n_test, n_train) of the surfaces, of the codes where no part knows surfaces: minus the distance."""
        for part in ("surfaces", "turned", "sizeless", "pairs"):
            if part in self._parts:
                surfaces: SurfaceKernels = getattr(self.comparisons, part)()
                return -surfaces.nearer(test, train)
        return -self.comparisons.pictures().nearer()[np.ix_(test, train)].astype(np.float32)

    def _compared(self, part: str, rows: IndexArray, train: IndexArray) -> ViewComparison:
        """How views ``rows`` compare with training views by one part."""
        grid = np.ix_(rows, train)
        if part == "complexities":
            found = self.comparisons.complexities()
            learned, asked = distance_features(found, train, rows)
            return ViewComparison(asked @ learned.T)
        if part == "codes":
            nearer = self.comparisons.pictures().nearer()
            return ViewComparison(self.comparisons.code_kernel()[grid], (nearer[grid],))
        surfaces: SurfaceKernels = getattr(self.comparisons, part)()
        among = rows is train
        return ViewComparison(
            surfaces.summed(rows, train, copies=self._copies, among=among),
            (surfaces.nearer(rows, train, copies=self._copies, among=among),),
            surfaces.with_mirrored(rows, train, copies=self._machine_copies, among=among),
        )


def distance_features(
    distances: MirroredDistances, train: IndexArray, test: IndexArray
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Features of the kernel of the distances, of training and test views; only training views are landmarks."""
    chosen = train
    if len(train) > MAX_LANDMARKS:
        chosen = train[np.linspace(0, len(train) - 1, MAX_LANDMARKS).astype(np.int64)]

    def block(rows: IndexArray) -> MirroredDistances:
        mirrored = distances.mirrored
        grid = np.ix_(rows, chosen)
        return MirroredDistances(distances.straight[grid], None if mirrored is None else mirrored[grid])

    features = DistanceFeatures(block(chosen))
    return features.of(block(train)), features.of(block(test))
