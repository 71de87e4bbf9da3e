"""Dictionaries from signals: learned online after Mairal et al. (paper eq. 1-2), or drawn at random."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.dictionary import Dictionary
from depthprint.errors import ConvergenceError, DataError, SettingsError
from depthprint.sparse_coding import sparse_code

__all__ = ["l1_objective", "learn_dictionary", "random_patches_dictionary"]

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[int, int], None]

PENALTIES = ("l1", "omp")

_FORGETTING = 2.0  # power of the past's fading: batches coded by poor early atoms should not count for long
_UPDATE_ROWS = 32  # atoms updated between two matrix products
_PRODUCT_ROWS, _PRODUCT_COLUMNS = 64, 1024  # of a matrix product, to a thread
_LASSO_ROUNDS = 2000
_TRAINING_TOLERANCE = 1e-6
_OBJECTIVE_TOLERANCE = 1e-7


def learn_dictionary(
    signals: npt.ArrayLike,
    n_atoms: int = 256,
    *,
    penalty: str = "l1",
    lambda_: float | None = None,
    n_nonzero: int = 4,
    batch_size: int = 256,
    n_passes: int = 5,
    seed: int = 0,
    progress: Progress | None = None,
) -> Dictionary:
    """Learn unit atoms D that represent signals sparsely, online, a mini-batch at a time.

    Minimises (1/n) sum_i min_a 1/2 ||x_i - D a||^2 + lambda ||a||_1 over D (eq. 1-2). Each batch is coded by
    the current atoms; its statistics A = sum a a', B = sum a x' are added to those of the past, which fade as
    they age; one round of block-coordinate descent on 1/2 tr(A D D') - tr(B D') moves the atoms. Atoms that
    nothing uses are replaced by signals that the dictionary represents badly.

    signals: (n, d) float; they are used as they are, neither centred nor scaled.
    penalty: ``l1`` codes a batch by the lasso; ``omp`` by OMP with ``n_nonzero`` atoms a signal, and the same
        update.
    lambda_: weight of the L1 norm, in units of the signals. None: 1.2 / sqrt(d) times their root mean square
        norm, so that scaling the signals does not change the atoms.
    n_passes: how often each signal is seen; each pass in a new seeded order.
    progress: called with (signals seen, signals to see).

    The same seed gives the same bits on any number of threads.

    Raises DataError for signals of a wrong shape or not finite, or with fewer distinct directions than
    ``n_atoms``; SettingsError for settings that cannot be.

    Source: paper eq. 1-2; Mairal, Bach, Ponce and Sapiro, Online Learning for Matrix Factorization and Sparse
        Coding,
    JMLR 2010, algorithms 1 and 2 with its mini-batches, rescaled past and removal of unused atoms. ``omp``:
    the same with the codes of Rubinstein, Zibulevsky and Elad 2008, close to online MOD.
    """
    x = _checked_signals(signals)
    for name, value in (
        ("n_atoms", n_atoms),
        ("n_nonzero", n_nonzero),
        ("batch_size", batch_size),
        ("n_passes", n_passes),
    ):
        if value < 1:
            raise SettingsError(f"{name}: expected at least 1, got {value}")
    if penalty not in PENALTIES:
        raise SettingsError(f"penalty: expected one of {', '.join(PENALTIES)}, got {penalty!r}")
    scale = _checked_scale(x)
    rng = np.random.default_rng(seed)
    atoms = _distinct_directions(x, n_atoms, rng, scale)
    weight = _checked_lambda(1.2 / np.sqrt(x.shape[1]) * scale if lambda_ is None else lambda_)

    past = _Past.empty(n_atoms, x.shape[1])
    total = n_passes * len(x)
    done = 0
    for _ in range(n_passes):
        order = rng.permutation(len(x))
        for start in range(0, len(x), batch_size):
            batch = x[np.sort(order[start : start + batch_size])].astype(np.float64)
            if penalty == "l1":
                codes = _lasso_codes(batch, atoms, weight, _TRAINING_TOLERANCE)
            else:
                codes = sparse_code(batch, atoms, n_nonzero=n_nonzero).to_dense()
            past.add(codes, batch, batch_size)
            past.update(atoms)
            _replace_unused(atoms, past, batch, codes, rng)
            done += len(batch)
            if progress is not None:
                progress(done, total)
    settings: dict[str, Any] = {"n_atoms": n_atoms, "batch_size": batch_size, "n_passes": n_passes}
    settings |= {"lambda_": weight} if penalty == "l1" else {"n_nonzero": n_nonzero}
    return Dictionary(atoms, f"learned-{penalty}", settings, seed)


def random_patches_dictionary(signals: npt.ArrayLike, n_atoms: int = 256, *, seed: int = 0) -> Dictionary:
    """Take signals themselves, scaled to norm 1, as atoms: what learning is to be compared with.

    signals: (n, d) float. No two atoms are the same up to sign. Raises DataError as ``learn_dictionary``
        does.
    """
    x = _checked_signals(signals)
    if n_atoms < 1:
        raise SettingsError(f"n_atoms: expected at least 1, got {n_atoms}")
    atoms = _distinct_directions(x, n_atoms, np.random.default_rng(seed), _checked_scale(x))
    return Dictionary(atoms, "random-patches", {"n_atoms": n_atoms}, seed)


def l1_objective(signals: npt.ArrayLike, atoms: Dictionary | npt.ArrayLike, lambda_: float) -> float:
    """Mean over signals of min_a 1/2 ||x - D a||^2 + lambda ||a||_1, each minimum solved to rounding (eq. 2).

    signals: (n, d) float; atoms: Dictionary or (K, d) unit rows; lambda_ in units of the signals.
    Raises ConvergenceError when a lasso does not reach its optimality conditions.
    """
    x = _checked_signals(signals)
    dictionary = Dictionary.of(atoms)
    if x.shape[1] != dictionary.dimension:
        raise DataError(
            f"signals: expected shape (n, {dictionary.dimension}) to fit the atoms, got {x.shape}"
        )
    _checked_scale(x)
    weight = _checked_lambda(lambda_)
    total = 0.0
    for start in range(0, len(x), 4096):
        part = x[start : start + 4096].astype(np.float64)
        codes = _lasso_codes(part, dictionary.atoms, weight, _OBJECTIVE_TOLERANCE)
        total += float(0.5 * np.square(part - codes @ dictionary.atoms).sum() + weight * np.abs(codes).sum())
    return total / len(x)


class _Past:
    """Statistics of the batches so far: usage A (K, K) and target B (K, d), means that fade with age."""

    def __init__(self, usage: FloatArray, target: FloatArray) -> None:
        self.usage = usage
        self.target = target
        self.batches = 0

    @classmethod
    def empty(cls, n_atoms: int, dimension: int) -> _Past:
        return cls(np.zeros((n_atoms, n_atoms)), np.zeros((n_atoms, dimension)))

    def add(self, codes: FloatArray, batch: FloatArray, batch_size: int) -> None:
        from depthprint._kernels.blocks import for_blocks

        self.batches += 1
        keep = (1 - 1 / self.batches) ** _FORGETTING
        shares = codes.T / batch_size

        def add_rows(start: int, stop: int) -> None:
            for past, of in ((self.usage, codes), (self.target, batch)):
                past[start:stop] *= keep
                past[start:stop] += shares[start:stop] @ of

        for_blocks(len(shares), _PRODUCT_ROWS, add_rows)

    def update(self, atoms: FloatArray) -> None:
        from depthprint._kernels.blocks import for_blocks
        from depthprint._kernels.lasso import update_atoms_block

        used = _used(self.usage)
        for first in range(0, len(atoms), _UPDATE_ROWS):
            rows = slice(first, first + _UPDATE_ROWS)
            pull = self.target[rows].copy()

            def subtract(start: int, stop: int, rows: slice = rows, pull: FloatArray = pull) -> None:
                pull[:, start:stop] -= self.usage[rows] @ atoms[:, start:stop]

            for_blocks(atoms.shape[1], _PRODUCT_COLUMNS, subtract)
            update_atoms_block(atoms, pull, self.usage, first, used)


def _used(usage: FloatArray) -> float:
    """Usage at or under which an atom counts as unused."""
    return 1e-6 * float(np.diag(usage).max())


def _replace_unused(
    atoms: FloatArray, past: _Past, batch: FloatArray, codes: FloatArray, rng: np.random.Generator
) -> None:
    unused = np.flatnonzero(np.diag(past.usage) <= _used(past.usage))
    if len(unused) == 0:
        return
    residuals = batch - codes @ atoms
    share = np.einsum("ij,ij->i", residuals, residuals)
    norms = np.sqrt(np.einsum("ij,ij->i", batch, batch))
    share[norms <= 1e-6 * norms.max()] = 0
    chosen = min(len(unused), int(np.count_nonzero(share)))
    if chosen == 0:
        return
    picks = rng.choice(len(batch), size=chosen, replace=False, p=share / share.sum())
    for k, i in zip(unused, picks, strict=False):
        atoms[k] = batch[i] / norms[i]
        past.usage[k] = past.usage[:, k] = 0
        past.target[k] = 0


def _lasso_codes(signals: FloatArray, atoms: FloatArray, weight: float, tolerance: float) -> FloatArray:
    from depthprint._kernels.blocks import for_blocks
    from depthprint._kernels.lasso import lasso_block

    codes = np.zeros((len(signals), len(atoms)))
    gram = np.empty((len(atoms), len(atoms)))

    def gram_rows(start: int, stop: int) -> None:
        gram[start:stop, start:] = atoms[start:stop] @ atoms[start:].T
        gram[start:, start:stop] = gram[start:stop, start:].T

    def code_block(start: int, stop: int) -> None:
        correlations = signals[start:stop] @ atoms.T
        failed = lasso_block(correlations, gram, weight, tolerance, _LASSO_ROUNDS, codes[start:stop])
        if failed:
            raise ConvergenceError(
                f"lasso: {failed} of {stop - start} signals did not meet the optimality conditions "
                f"to {tolerance:g}"
            )

    for_blocks(len(atoms), _PRODUCT_ROWS, gram_rows)
    for_blocks(len(signals), 64, code_block)
    return codes


def _distinct_directions(
    x: npt.NDArray[Any], n_atoms: int, rng: np.random.Generator, scale: float
) -> FloatArray:
    """Signals drawn without replacement and scaled to norm 1, none twice up to sign, none near zero."""
    atoms = np.empty((n_atoms, x.shape[1]))
    seen: set[bytes] = set()
    for i in rng.permutation(len(x)):
        signal = x[i].astype(np.float64)
        norm = float(np.sqrt(signal @ signal))
        if norm <= 1e-6 * scale:
            continue
        signal /= norm
        rounded = np.rint(signal * 1e6).astype(np.int64)
        key = rounded * np.sign(rounded[np.argmax(np.abs(rounded))])
        if key.tobytes() in seen:
            continue
        atoms[len(seen)] = signal
        seen.add(key.tobytes())
        if len(seen) == n_atoms:
            return atoms
    raise DataError(
        f"signals: expected at least {n_atoms} that differ in direction, one for each atom, got {len(seen)} "
        f"among {len(x)}; give more signals or ask for fewer atoms"
    )


def _checked_signals(signals: npt.ArrayLike) -> npt.NDArray[Any]:
    x = np.asarray(signals)
    if x.dtype not in (np.float32, np.float64):
        raise DataError(f"signals: expected float32 or float64, got {x.dtype}")
    if x.ndim != 2 or 0 in x.shape:
        raise DataError(f"signals: expected shape (n, d) with n, d >= 1, got {x.shape}")
    for start in range(0, len(x), 4096):
        finite = np.isfinite(x[start : start + 4096]).all(axis=1)
        if not finite.all():
            raise DataError(
                f"signals: expected finite values, row {start + int(np.argmin(finite))} holds NaN or infinity"
            )
    return x


def _checked_scale(x: npt.NDArray[Any]) -> float:
    """Root mean square norm of the signals."""
    total = 0.0
    for start in range(0, len(x), 4096):
        part = x[start : start + 4096].astype(np.float64)
        total += float(np.einsum("ij,ij->", part, part))
    scale = float(np.sqrt(total / len(x)))
    if not np.isfinite(scale):
        raise DataError("signals: too large for double precision; scale them down")
    return scale


def _checked_lambda(value: float) -> float:
    if not 0 < value < np.inf:
        raise SettingsError(f"lambda_: expected a finite number > 0, got {value!r}")
    return float(value)
