"""Linear support vector machine for few long vectors: all classes at once, on the matrix of inner products."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from depthprint.errors import ConvergenceError, DataError, SettingsError

__all__ = ["GramSvm", "LinearSvm", "gram_matrix", "linear_directions"]

Float32Array = npt.NDArray[np.float32]

BLOCK_ROWS = 64
GRAM_BLOCK_ROWS = 512


def gram_matrix(vectors: Float32Array) -> Float32Array:
    """Inner products (n, n) of rows, the same bits on any number of threads."""
    from depthprint._kernels.blocks import for_blocks

    gram = np.empty((len(vectors), len(vectors)), dtype=np.float32)

    def block(start: int, stop: int) -> None:
        gram[start:stop, :stop] = vectors[start:stop] @ vectors[:stop].T
        gram[:start, start:stop] = gram[start:stop, :start].T

    for_blocks(len(vectors), GRAM_BLOCK_ROWS, block)
    return gram


class GramSvm:
    """One-vs-rest L2-regularised squared-hinge machine on inner products, without intercept.

    C: weight of the errors. tolerance: largest violation of optimality, in units of the margin. ``fit`` raises
    ConvergenceError when ``max_passes`` over the data do not reach it.
    Source: Hsieh, Chang, Lin, Keerthi and Sundararajan 2008 (dual coordinate descent). A block of rows is
    scored by one matrix product for all classes, which is what makes it fast where vectors are long; the steps
    are those of the plain algorithm.
    """

    def __init__(
        self, C: float = 10.0, *, tolerance: float = 0.01, max_passes: int = 3000, seed: int = 0
    ) -> None:
        if not (np.isfinite(C) and C > 0):
            raise SettingsError(f"C: expected a positive number, got {C!r}")
        self._ridge = 1.0 / (2.0 * C)
        self._tolerance = tolerance
        self._max_passes = max_passes
        self._seed = seed
        self.labels: npt.NDArray[Any] = np.empty(0)
        self.multipliers: Float32Array = np.empty((0, 0), dtype=np.float32)
        self.n_passes = 0

    def fit(self, gram: Float32Array, labels: npt.ArrayLike) -> GramSvm:
        """Learn from inner products (n, n) and labels (n,).

        Afterwards ``labels`` (n_labels,) are the different ones, sorted, and scores are rows of inner products
        with the training vectors times ``multipliers`` (n, n_labels).
        """
        given = np.asarray(labels)
        if gram.shape != (len(given), len(given)):
            raise DataError(
                f"GramSvm: expected a matrix ({len(given)}, {len(given)}) for {len(given)} labels, got {gram.shape}"
            )
        if not np.isfinite(gram).all():
            raise DataError("GramSvm: expected finite inner products, got NaN or infinity")
        self.labels, numbers = np.unique(given, return_inverse=True)
        if len(self.labels) < 2:
            raise DataError(f"GramSvm: expected two classes or more, got {len(self.labels)}")
        generator = np.random.default_rng(self._seed)
        order = generator.permutation(len(given))
        shuffled = np.ascontiguousarray(gram[np.ix_(order, order)], dtype=np.float32)
        signs = np.where(numbers[order, None] == np.arange(len(self.labels)), 1, -1).astype(np.float32)
        solved = self._descend(shuffled, signs, generator)
        self.multipliers = np.empty_like(solved)
        self.multipliers[order] = solved
        self.multipliers.setflags(write=False)
        return self

    def scores(self, gram: Float32Array) -> npt.NDArray[np.float64]:
        """Margins (m, n_labels) of vectors by their inner products (m, n) with the training vectors."""
        if gram.ndim != 2 or gram.shape[1] != len(self.multipliers):
            raise DataError(
                f"GramSvm: expected inner products (m, {len(self.multipliers)}), got {gram.shape}"
            )
        return np.asarray(gram @ self.multipliers, dtype=np.float64)

    def _descend(
        self, gram: Float32Array, signs: Float32Array, generator: np.random.Generator
    ) -> Float32Array:
        from depthprint._kernels.blocks import one_blas_thread
        from depthprint._kernels.dual_descent import descend_block

        solved = np.zeros_like(signs)
        active: npt.NDArray[np.intp] = np.arange(signs.shape[1])
        signs_left, left = signs, solved.copy()
        starts = np.arange(0, len(gram), BLOCK_ROWS)
        squares = [np.ascontiguousarray(gram[s : s + BLOCK_ROWS, s : s + BLOCK_ROWS]) for s in starts]
        with one_blas_thread():
            for done in range(self._max_passes):
                worst = np.zeros(len(active), dtype=np.float32)
                for block in generator.permutation(len(starts)):
                    rows = slice(starts[block], starts[block] + BLOCK_ROWS)
                    scores = gram[rows] @ left
                    descend_block(squares[block], scores, signs_left[rows], left[rows], self._ridge, worst)
                solved[:, active] = left
                open_still = worst > self._tolerance
                self.n_passes = done + 1
                if not open_still.any():
                    return solved
                if not open_still.all():
                    active = active[open_still]
                    signs_left, left = (np.ascontiguousarray(m[:, open_still]) for m in (signs_left, left))
        raise ConvergenceError(
            f"GramSvm: {len(active)} of {signs.shape[1]} classes are not within {self._tolerance} of the optimum "
            f"after {self._max_passes} passes"
        )


def linear_directions(
    vectors: Float32Array, numbers: npt.NDArray[np.integer[Any]], C: float
) -> npt.NDArray[np.float64]:
    """Directions (d, c) of the machine that GramSvm seeks, for many vectors (n, d), by LIBLINEAR in their own space.

    numbers (n,): the class of each, 0 to c - 1. Raises ConvergenceError where it does not come near the optimum.
    """
    import warnings

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.svm import LinearSVC

    machine = LinearSVC(C=C, dual=False, fit_intercept=False, max_iter=10_000)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ConvergenceWarning)
        try:
            found = machine.fit(vectors, numbers).coef_
        except ConvergenceWarning as warning:
            raise ConvergenceError(f"linear machine of {len(vectors)} vectors: {warning}") from warning
    # Of two classes it gives the second one's direction alone.
    return np.ascontiguousarray((np.concatenate([-found, found]) if len(found) == 1 else found).T)


class LinearSvm(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """GramSvm as a scikit-learn classifier of vectors: the optimum that LinearSVC(fit_intercept=False) seeks.

    Made for vectors longer than there are samples; memory goes with the square of the samples.
    """

    def __init__(
        self, C: float = 10.0, *, tolerance: float = 0.01, max_passes: int = 3000, random_state: int = 0
    ) -> None:
        self.C = C
        self.tolerance = tolerance
        self.max_passes = max_passes
        self.random_state = random_state

    def fit(self, X: npt.ArrayLike, y: npt.ArrayLike) -> LinearSvm:
        """Learn from vectors (n, d) and labels (n,)."""
        vectors, labels = validate_data(self, X, y, dtype=np.float32)
        check_classification_targets(labels)
        machine = GramSvm(
            self.C, tolerance=self.tolerance, max_passes=self.max_passes, seed=self.random_state
        ).fit(gram_matrix(vectors), labels)
        self.classes_ = machine.labels
        self.coef_ = machine.multipliers.T @ vectors
        self.n_iter_ = machine.n_passes
        return self

    def decision_function(self, X: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Margins (n, n_classes); (n,) of the second class where there are two."""
        check_is_fitted(self, "coef_")
        vectors = validate_data(self, X, dtype=np.float32, reset=False)
        margins = np.asarray(vectors @ self.coef_.T, dtype=np.float64)
        return margins[:, 1] if len(self.classes_) == 2 else margins

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """Labels (n,)."""
        margins = self.decision_function(X)
        best = (margins > 0).astype(np.int64) if margins.ndim == 1 else margins.argmax(1)
        return np.asarray(self.classes_[best])
