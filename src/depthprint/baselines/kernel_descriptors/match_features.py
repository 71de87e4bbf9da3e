"""Efficient match kernels: descriptors of a crop become one vector, over a vocabulary and a pyramid of cells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.match_kernel import gaussian_products
from depthprint.baselines.kernel_descriptors.patch_grid import PatchDescriptors
from depthprint.errors import DataError, SettingsError

__all__ = ["PYRAMID", "Vocabulary", "learn_vocabulary", "match_features", "match_rows", "power_transform"]

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[int, int], None]

PYRAMID = (1, 2, 3)
DESCRIPTORS_PER_CROP = 10
KMEANS_STEPS = 50
# Added to the words' kernel matrix, which near words make singular.
RIDGE = 1e-6
POWER = 0.3
_LEVELS = np.array(PYRAMID)


@dataclass(frozen=True)
class Vocabulary:
    """Visual words and the map that makes their kernel space Euclidean; arrays are read-only.

    words: (w, k) float64. gamma: width of the match kernel. whitening: (w, w) upper triangular G, with
    G^T G = (K_words + 1e-6 I)^-1.
    """

    words: FloatArray
    gamma: float
    whitening: FloatArray

    @classmethod
    def of(cls, words: npt.ArrayLike, gamma: float) -> Vocabulary:
        """Compute the map of words (w, k); SettingsError for a gamma that is not positive."""
        from scipy.linalg import solve_triangular

        from depthprint._kernels.blocks import one_blas_thread

        if not gamma > 0:
            raise SettingsError(f"Vocabulary: expected gamma > 0, got {gamma}")
        centres = np.array(words, dtype=np.float64)
        if centres.ndim != 2 or not len(centres) or not np.isfinite(centres).all():
            raise DataError(f"Vocabulary: expected finite words (w, k), got shape {centres.shape}")
        with one_blas_thread():
            kernel = gaussian_products(centres, centres, gamma) + RIDGE * np.eye(len(centres))
            # kernel = U U^T with U upper triangular, so U^-1 is the Cholesky factor of the inverse, never formed:
            # the inverse of a matrix so near singular is no longer positive.
            upper = np.linalg.cholesky(kernel[::-1, ::-1])[::-1, ::-1]
            whitening = solve_triangular(upper, np.eye(len(centres)))
        for array in (centres, whitening):
            array.setflags(write=False)
        return cls(centres, float(gamma), whitening)

    def responses(self, vectors: npt.NDArray[np.float32]) -> FloatArray:
        """Match kernel (m, w) of descriptors (m, k) with the words."""
        squares, factors = self._factors
        points = vectors.astype(np.float64)
        exponents = points @ factors
        exponents -= self.gamma * (points * points).sum(1)[:, None]
        exponents -= squares
        np.minimum(exponents, 0.0, out=exponents)
        return np.asarray(np.exp(exponents, out=exponents))

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray]:
        """What the words alone add to the exponents, (w,), and what they are multiplied by, (k, w)."""
        return self.gamma * (self.words**2).sum(1), np.ascontiguousarray(2 * self.gamma * self.words.T)

    @property
    def n_features(self) -> int:
        """Length of a crop's vector."""
        return len(self.words) * sum(n * n for n in PYRAMID)


def learn_vocabulary(
    crops: Sequence[PatchDescriptors], gamma: float, *, n_words: int = 1000, seed: int = 0
) -> Vocabulary:
    """k-means words of at most 10 random descriptors a crop.

    There are fewer than ``n_words`` where there are fewer different descriptors. Raises DataError when no crop
    has a descriptor. Source: Bo and Sminchisescu 2009.
    """
    from sklearn.cluster import KMeans
    from threadpoolctl import threadpool_limits

    if n_words < 1:
        raise SettingsError(f"n_words: expected at least 1, got {n_words}")
    generator = np.random.default_rng(seed)
    drawn = [
        crop.vectors[generator.permutation(len(crop.vectors))[:DESCRIPTORS_PER_CROP]]
        for crop in crops
        if len(crop.vectors)
    ]
    if not drawn:
        raise DataError("vocabulary: expected descriptors to learn words from, got none in any crop")
    sample = np.unique(np.concatenate(drawn), axis=0)
    if len(sample) <= n_words:
        return Vocabulary.of(sample, gamma)
    means = KMeans(n_words, init="random", n_init=1, max_iter=KMEANS_STEPS, tol=0.0, random_state=seed)
    # Threads would add up the members of a cluster in another order each time.
    with threadpool_limits(1):
        return Vocabulary.of(means.fit(sample).cluster_centers_, gamma)


def match_features(
    crops: Sequence[PatchDescriptors], vocabulary: Vocabulary, progress: Progress | None = None
) -> npt.NDArray[np.float32]:
    """Vectors (n, 14 w) float32 of crops: cells of the pyramid 1x1, 2x2, 3x3, row by row, one after another.

    In a cell each word keeps, of the descriptors nearest to it, the one that responds most; the cell's vector is
    G times the mean response of those kept to all words, weighed by the inverse number of cells of its level.
    A cell without descriptors is zero. Source: Bo and Sminchisescu 2009; selection and weights as kdes 2.0 has them.
    """
    from depthprint._kernels.blocks import for_blocks

    features = np.empty((len(crops), vocabulary.n_features), dtype=np.float32)

    def block(start: int, stop: int) -> None:
        features[start:stop] = match_rows(crops[start:stop], vocabulary)

    for_blocks(len(crops), 16, block, progress)
    return features


def match_rows(crops: Sequence[PatchDescriptors], vocabulary: Vocabulary) -> npt.NDArray[np.float32]:
    """``match_features`` of a few crops on the calling thread."""
    means = _cell_means(crops, vocabulary)
    cells = means.reshape(-1, means.shape[2]) @ vocabulary.whitening.T
    weighed = cells.reshape(means.shape) * _level_weights()[:, None]
    return weighed.reshape(len(crops), -1).astype(np.float32)


@lru_cache(maxsize=1)
def _level_weights() -> FloatArray:
    """Weight of each cell of the pyramid, (14,)."""
    weights = np.array([1.0 / n**2 for n in PYRAMID])
    return np.repeat(weights / weights.sum(), [n * n for n in PYRAMID])


def power_transform(features: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """sign(x) |x|^0.3: what the authors give their classifier."""
    powers = np.abs(features)
    np.power(powers, np.float32(POWER), out=powers)
    np.copysign(powers, features, out=powers)
    return powers


def _cell_means(crops: Sequence[PatchDescriptors], vocabulary: Vocabulary) -> FloatArray:
    """Mean response (n, 14, w) of the descriptors kept in each cell of each crop."""
    from depthprint._kernels.kept_responses import kept_means

    # Those of a mirror image may be the very same vectors at other places.
    vectors = list({id(crop.vectors): crop.vectors for crop in crops}.values())
    ends = np.cumsum([len(v) for v in vectors])[:-1]
    found = np.split(vocabulary.responses(np.concatenate(vectors)), ends) if vectors else []
    responses = {id(v): rows for v, rows in zip(vectors, found, strict=True)}
    means = []
    for crop in crops:
        columns, rows = crop.positions.T
        means.append(kept_means(responses[id(crop.vectors)], columns, rows, _LEVELS))
    return np.stack(means)
