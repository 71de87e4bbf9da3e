"""Linear discriminant analysis on a kernel: classes as means in a space where the spread within them is even."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, ModelError, SettingsError

__all__ = ["KernelDiscriminant", "discriminant_directions"]

FloatArray = npt.NDArray[np.float64]


class KernelDiscriminant:
    """Regularised linear discriminant analysis in the feature space of a positive semi-definite kernel.

    With class means m_c and the covariance S within the classes, a view x gets the score
    x' (S + l I)^-1 m_c - m_c' (S + l I)^-1 m_c / 2, the log-likelihood of the class up to a constant; l is
    ``shrinkage`` times the mean eigenvalue of S. Everything is expressed by kernel values, by way of
    (S + l I)^-1 F' = F' (l I + H K / n)^-1, where K = F F' and H takes class means away.
    """

    def __init__(self, shrinkage: float = 0.5) -> None:
        if not (np.isfinite(shrinkage) and shrinkage > 0):
            raise SettingsError(f"KernelDiscriminant: expected shrinkage > 0, got {shrinkage}")
        self.shrinkage = shrinkage
        self.labels: npt.NDArray[Any] = np.empty(0)
        self.weights: FloatArray = np.empty((0, 0))
        self.offsets: FloatArray = np.empty(0)

    def fit(self, kernel: npt.ArrayLike, labels: npt.ArrayLike) -> KernelDiscriminant:
        """Learn from kernel values (n, n) and labels (n,); one view a class may do, two classes must be there.

        Raises DataError for other shapes, values not finite, a single class, or a kernel that is far from positive
        semi-definite.
        """
        from scipy.linalg import LinAlgError, cho_factor, cho_solve

        values = np.asarray(kernel, dtype=np.float64)
        self.labels, number = np.unique(np.asarray(labels), return_inverse=True)
        n = len(number)
        if values.shape != (n, n) or not np.isfinite(values).all():
            raise DataError(
                f"KernelDiscriminant: expected finite kernel values ({n}, {n}), got {values.shape}"
            )
        if len(self.labels) < 2:
            raise DataError("KernelDiscriminant: expected two classes or more, got one")
        members = np.eye(len(self.labels))[number]
        mean = members / members.sum(axis=0)
        centred = values - members @ (mean.T @ values)
        spread = centred - (centred @ mean) @ members.T
        spread = (spread + spread.T) / (2 * n)
        # One view a class has no spread within: any l ranks alike then, by distance to the means.
        ridge = self.shrinkage * max(float(np.trace(spread)), 1e-6 * float(np.trace(values)) / n) / n
        spread[np.diag_indices(n)] += ridge
        try:
            factor = cho_factor(spread, lower=True, overwrite_a=True)
        except LinAlgError as error:
            raise DataError("KernelDiscriminant: the kernel is not positive semi-definite") from error
        solved = cho_solve(factor, centred @ mean / n)
        self.weights = (mean - solved + members @ (mean.T @ solved)) / ridge
        self.offsets = -0.5 * ((mean.T @ values) * self.weights.T).sum(axis=1)
        return self

    def scores(self, kernel: npt.ArrayLike) -> FloatArray:
        """Scores (m, c) from kernel values (m, n) of queries with the n views learned from."""
        if not len(self.weights):
            raise ModelError("KernelDiscriminant: not fitted")
        values = np.asarray(kernel, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != len(self.weights):
            raise DataError(
                f"KernelDiscriminant: expected kernel values (m, {len(self.weights)}), got {values.shape}"
            )
        return np.asarray(values @ self.weights + self.offsets)


def discriminant_directions(
    rows: npt.NDArray[np.floating[Any]], numbers: npt.NDArray[np.integer[Any]], shrinkage: float
) -> tuple[FloatArray, FloatArray]:
    """The same from vectors (n, d) themselves: directions (d, c) and offsets (c,), of which scores are the products.

    numbers (n,): the class of each row, 0 to c - 1, each there. Memory goes with n and with d squared, that of a
    kernel with n squared.
    """
    from scipy.linalg import solve

    values = np.asarray(rows, dtype=np.float64)
    n, d = values.shape
    counts = np.bincount(numbers)
    means = np.zeros((len(counts), d))
    np.add.at(means, numbers, values)
    means /= counts[:, None]
    within = values - means[numbers]
    spread = within.T @ within / n
    lengths = float(np.einsum("ij,ij->", values, values))
    ridge = shrinkage * max(float(np.trace(spread)), 1e-6 * lengths / n) / n
    spread[np.diag_indices(d)] += ridge
    directions = solve(spread, means.T, assume_a="pos")
    return np.asarray(directions), -0.5 * (means.T * directions).sum(axis=0)
