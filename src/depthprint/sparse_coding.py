"""Sparse models over a dictionary: OMP (paper eq. 3-7), its OLS variant and plain matching pursuit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.dictionary import Dictionary
from depthprint.errors import DataError, SettingsError

__all__ = ["ALGORITHMS", "SparseModel", "sparse_code"]

ALGORITHMS = ("omp", "ols", "mp")

# Below these an inner product or a squared distance is rounding, not signal.
_ZERO_IN_ULPS = 8.0
_DEPENDENT = {np.dtype(np.float32): 1e-4, np.dtype(np.float64): 1e-8}
# Above this share of the signal's energy what is left is told by the steps to some 1e-5 (1e-9) of itself;
# below it the pixels are asked.
_TRUSTED = {np.dtype(np.float32): 1e-2, np.dtype(np.float64): 1e-5}


@dataclass(frozen=True)
class SparseModel:
    """Sparse models of n signals in compressed rows; all arrays are read-only.

    Row i is ``indices[indptr[i]:indptr[i + 1]]``: numbers of atoms in the order of picking, no number twice,
    with their ``coefficients``; ``residual_norms[i]`` is the norm of what the model leaves unexplained.

    indptr: (n + 1,) int64. indices: (nnz,) int32. coefficients: (nnz,) and residual_norms: (n,) float32 or
        float64.
    n_atoms: size of the dictionary.
    """

    indptr: npt.NDArray[np.int64]
    indices: npt.NDArray[np.int32]
    coefficients: npt.NDArray[Any]
    residual_norms: npt.NDArray[Any]
    n_atoms: int

    def __post_init__(self) -> None:
        nnz = len(self.indices)
        ends_fit = len(self.indptr) > 0 and self.indptr[0] == 0 and self.indptr[-1] == nnz
        if not ends_fit or (np.diff(self.indptr) < 0).any():
            raise DataError(f"SparseModel.indptr: expected non-decreasing values from 0 to {nnz}")
        if self.coefficients.shape != (nnz,) or self.residual_norms.shape != (len(self.indptr) - 1,):
            raise DataError(
                f"SparseModel: expected {nnz} coefficients and {len(self.indptr) - 1} residual norms, got "
                f"{self.coefficients.shape} and {self.residual_norms.shape}"
            )
        if nnz and not (self.indices.min() >= 0 and self.indices.max() < self.n_atoms):
            raise DataError(f"SparseModel.indices: expected atom numbers in 0..{self.n_atoms - 1}")
        for name in ("indptr", "indices", "coefficients", "residual_norms"):
            array = getattr(self, name).view()
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.indptr) - 1

    def row(self, index: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[Any]]:
        """Atom numbers and coefficients of one signal, in the order of picking."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"SparseModel has {len(self)} rows, got index {index}")
        index %= len(self)
        part = slice(self.indptr[index], self.indptr[index + 1])
        return self.indices[part], self.coefficients[part]

    def rows(self, start: int, stop: int) -> SparseModel:
        """The models of the signals from ``start`` to before ``stop``."""
        entries = slice(self.indptr[start], self.indptr[stop])
        return SparseModel(
            self.indptr[start : stop + 1] - self.indptr[start],
            self.indices[entries],
            self.coefficients[entries],
            self.residual_norms[start:stop],
            self.n_atoms,
        )

    def spread(self, coded: npt.NDArray[np.bool_]) -> SparseModel:
        """The models in the places where ``coded`` (m,) is true, and empty ones of zero signals elsewhere."""
        if coded.shape != (len(coded),) or np.count_nonzero(coded) != len(self):
            raise DataError(f"SparseModel.spread: expected {len(self)} places, got {np.count_nonzero(coded)}")
        indptr = self.indptr[np.concatenate([[0], np.cumsum(coded)])]
        residual_norms = np.zeros(len(coded), dtype=self.residual_norms.dtype)
        residual_norms[coded] = self.residual_norms
        return SparseModel(indptr, self.indices, self.coefficients, residual_norms, self.n_atoms)

    def to_dense(self) -> npt.NDArray[Any]:
        """Coefficients as an (n, n_atoms) array, zero where an atom was not picked."""
        dense = np.zeros((len(self), self.n_atoms), dtype=self.coefficients.dtype)
        dense[np.repeat(np.arange(len(self)), np.diff(self.indptr)), self.indices] = self.coefficients
        return dense

    def reconstruct(self, dictionary: Dictionary | npt.ArrayLike) -> npt.NDArray[Any]:
        """Signals that the models stand for, (n, d): eq. 7 without its residual.

        Raises DataError when the dictionary is of another size than the one that made the models.
        """
        from scipy.sparse import csr_array

        atoms = Dictionary.of(dictionary).atoms_as(self.coefficients.dtype)
        if len(atoms) != self.n_atoms:
            raise DataError(f"reconstruct: expected a dictionary of {self.n_atoms} atoms, got {len(atoms)}")
        codes = csr_array((self.coefficients, self.indices, self.indptr), shape=(len(self), self.n_atoms))
        return np.asarray(codes @ atoms)


def sparse_code(
    signals: npt.ArrayLike,
    dictionary: Dictionary | npt.ArrayLike,
    *,
    algorithm: str = "omp",
    n_nonzero: int | None = 20,
    residual_tolerance: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> SparseModel:
    """Approximate each signal by few atoms, picked one after another.

    signals: (n, d) float32 or float64. dictionary: a Dictionary or (K, d) unit rows.
    algorithm: ``omp`` picks the atom with the largest |<R, g>| and projects on the span of all picked;
        ``ols`` picks the atom that lessens the residual most, then projects; ``mp`` picks as OMP does and
        subtracts, without projecting, so an atom may be picked again and adds to its coefficient.
    n_nonzero: most atoms of a model (of ``mp``: most steps). None: no limit but that of the dimension.
    residual_tolerance: stop when the residual's norm, in units of the signals, is at or under it. Judged by
        an updated squared norm, good to about 1e-8 of the signal's norm. The arithmetic is then double
        whatever the input.
    progress: called with (signals done, signals in all).

    Zero signals get empty models. A pursuit ends early when the residual correlates with no atom beyond
    rounding or when the best atom depends linearly on those picked. Otherwise float32 signals are coded in
    float32. The same bits come out on any number of threads.

    Raises DataError for signals of a wrong shape or type or not finite (the message names the row),
    SettingsError for settings that cannot be.

    Source: paper eq. 3-7; Batch-OMP as in Rubinstein, Zibulevsky and Elad 2008 by a partial Cholesky factor
        of the
    Gram matrix; OLS: Chen, Billings and Luo 1989; matching pursuit: Mallat and Zhang 1993.
    """
    from depthprint._kernels import pursuit
    from depthprint._kernels.blocks import for_blocks
    from depthprint._kernels.products import BLOCK_ROWS, block_rows_for

    d = Dictionary.of(dictionary)
    x = _checked_signals(signals, d)
    limit = _checked_limit(algorithm, n_nonzero, residual_tolerance, d)
    dtype = np.dtype(np.float64) if residual_tolerance is not None else x.dtype
    tolerance = -1.0 if residual_tolerance is None else float(residual_tolerance)
    zero = _ZERO_IN_ULPS * float(np.finfo(dtype).eps) * float(np.sqrt(d.dimension))
    atoms, gram = d.atoms_as(dtype), d.gram_as(dtype)

    n = len(x)
    picked = np.empty((n, limit), dtype=np.int32)
    coefficients = np.empty((n, limit), dtype=dtype)
    counts = np.empty(n, dtype=np.int64)
    residual_norms = np.empty(n, dtype=dtype)

    def code_block(start: int, stop: int) -> None:
        rows = stop - start
        block = x[start:stop]
        height = block_rows_for(rows, dtype.name, d.n_atoms, d.dimension)
        if rows < height or block.dtype != dtype or not block.flags.c_contiguous:
            block = np.zeros((height, d.dimension), dtype=dtype)
            block[:rows] = x[start:stop]
        squared = np.empty(rows)
        pursuit.squared_norms(block[:rows], squared)
        _refuse_non_finite(squared, x, start)
        correlations = block @ atoms.T
        score = np.empty(d.n_atoms, dtype=dtype)
        bits = score.view(np.int32 if dtype.itemsize == 4 else np.int64)
        into = slice(start, stop)
        codes = (picked[into], coefficients[into], counts[into])
        given = (correlations[:rows], gram, squared, tolerance, zero)
        if algorithm == "mp":
            pursuit.mp_block(*given, score, bits, *codes)
            residual_norms[into] = -1.0  # still to be found
        else:
            limits = (_DEPENDENT[dtype], _TRUSTED[dtype])
            pursuit.omp_block(*given, *limits, algorithm == "ols", score, bits, *codes, residual_norms[into])
        pursuit.residual_norms_block(block[:rows], atoms, *codes, residual_norms[into])

    work = float(n) * d.n_atoms * (d.dimension + limit * limit)
    for_blocks(n, BLOCK_ROWS, code_block, progress, multiplications=work)

    kept = np.arange(limit) < counts[:, None]
    indptr = np.zeros(n + 1, dtype=np.int64)
    np.cumsum(counts, out=indptr[1:])
    return SparseModel(
        indptr,
        picked[kept],
        coefficients[kept].astype(x.dtype, copy=False),
        residual_norms.astype(x.dtype, copy=False),
        d.n_atoms,
    )


def _checked_signals(signals: npt.ArrayLike, dictionary: Dictionary) -> npt.NDArray[Any]:
    x = np.asarray(signals)
    if x.dtype not in _DEPENDENT:
        raise DataError(f"signals: expected float32 or float64, got {x.dtype}")
    if x.ndim != 2 or x.shape[1] != dictionary.dimension:
        raise DataError(
            f"signals: expected shape (n, {dictionary.dimension}) to fit the dictionary, got {x.shape}"
        )
    return x


def _checked_limit(
    algorithm: str, n_nonzero: int | None, residual_tolerance: float | None, dictionary: Dictionary
) -> int:
    if algorithm not in ALGORITHMS:
        raise SettingsError(f"algorithm: expected one of {', '.join(ALGORITHMS)}, got {algorithm!r}")
    if residual_tolerance is not None and not 0 <= residual_tolerance < np.inf:
        raise SettingsError(f"residual_tolerance: expected a finite number >= 0, got {residual_tolerance!r}")
    largest = min(dictionary.n_atoms, dictionary.dimension)
    if n_nonzero is None:
        if algorithm == "mp":
            raise SettingsError("n_nonzero: matching pursuit needs a number of steps, got None")
        return largest
    if n_nonzero < 1:
        raise SettingsError(f"n_nonzero: expected at least 1, got {n_nonzero}")
    return n_nonzero if algorithm == "mp" else min(n_nonzero, largest)


def _refuse_non_finite(squared: npt.NDArray[np.float64], x: npt.NDArray[Any], start: int) -> None:
    # Half the range of the type, so that no inner product with a unit atom can overflow.
    largest = float(np.finfo(x.dtype).max) / 4
    bad = ~(np.sqrt(squared) < largest)
    if bad.any():
        row = start + int(np.argmax(bad))
        if np.isfinite(x[row]).all():
            raise DataError(f"signals: row {row} is too large for {x.dtype}; scale the signals down")
        raise DataError(f"signals: expected finite values, row {row} holds NaN or infinity")
