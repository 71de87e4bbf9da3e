"""Sparse coding of many whole images, two threads, against scikit-learn and spams."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.data import N_PLACES, load_images
from benchmarks.harness import Comparison, Settings, interleaved_s, threads, version
from depthprint import Dictionary, load_shipped_encoder, sparse_code

__all__ = ["NAMES", "run"]

NAMES = ("omp_sklearn", "omp_sklearn_float64", "omp_spams", "omp_spams_float64")
N_NONZERO = 20
# spams.omp picks the atom that lessens the residual most, which is what is called OLS here.
_PEERS = {
    "sklearn": ("omp", "orthogonal_mp_gram", "scikit-learn"),
    "spams": ("ols", "spams.omp", "spams-bin"),
}


def run(settings: Settings, wanted: set[str]) -> list[Comparison]:
    """The rows asked for, each precision with both peers in the same rounds."""
    images = load_images(300 if settings.quick else N_PLACES)
    dictionary = load_shipped_encoder("literal").streams[0].dictionary
    rows: list[Comparison] = []
    with threads(settings.threads), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # peers warn of dependent atoms and of their own deprecations
        for dtype, suffix in ((np.float32, ""), (np.float64, "_float64")):
            names = [peer for peer in _PEERS if f"omp_{peer}{suffix}" in wanted]
            if names:
                rows += _compare(images.astype(dtype), dictionary, names, suffix, settings)
    return rows


def _compare(
    x: npt.NDArray[Any], dictionary: Dictionary, names: list[str], suffix: str, settings: Settings
) -> list[Comparison]:
    atoms = dictionary.atoms.astype(x.dtype)
    makers = {"sklearn": _scikit_learn, "spams": _spams}
    contestants: dict[str, Callable[[], Any]] = {}
    notes, same = {}, {}
    for name in names:
        algorithm = _PEERS[name][0]
        ours = contestants[algorithm] = partial(
            sparse_code, x, dictionary, algorithm=algorithm, n_nonzero=N_NONZERO
        )
        try:
            contestants[name] = makers[name](x, atoms, settings.threads)
        except ImportError as error:
            notes[name] = f"no ready-made wheel for this Python: {error}"
            continue
        same[name] = _same_supports(contestants[name](), ours().to_dense())
    taken = interleaved_s(contestants, warm=False)
    return [_row(name, suffix, x, atoms, taken, notes, same, settings) for name in names]


def _row(
    name: str,
    suffix: str,
    x: npt.NDArray[Any],
    atoms: npt.NDArray[Any],
    taken: Mapping[str, float],
    notes: Mapping[str, str],
    same: Mapping[str, float],
    settings: Settings,
) -> Comparison:
    algorithm, peer, package = _PEERS[name]
    size = (
        f"{len(x)} x {x.shape[1]}, {len(atoms)} atoms, {N_NONZERO} non-zeros, {x.dtype}, {algorithm.upper()}"
    )
    extra = {"share_of_same_supports": same[name]} if name in same else {}
    return Comparison(
        f"omp_{name}{suffix}", taken[algorithm], taken.get(name), peer, version(package), settings.threads, size,
        "batch", notes.get(name, ""), extra,
    )  # fmt: skip


def _scikit_learn(x: npt.NDArray[Any], atoms: npt.NDArray[Any], _: int) -> Callable[[], npt.NDArray[Any]]:
    from sklearn.linear_model import orthogonal_mp_gram

    def code() -> npt.NDArray[Any]:
        return np.asarray(orthogonal_mp_gram(atoms @ atoms.T, atoms @ x.T, n_nonzero_coefs=N_NONZERO).T)

    return code


def _spams(x: npt.NDArray[Any], atoms: npt.NDArray[Any], n: int) -> Callable[[], npt.NDArray[Any]]:
    import spams

    columns, dictionary = np.asfortranarray(x.T), np.asfortranarray(atoms.T)
    return lambda: np.asarray(spams.omp(columns, dictionary, L=N_NONZERO, numThreads=n).T.todense())


def _same_supports(theirs: npt.NDArray[Any], found: npt.NDArray[Any]) -> float:
    """Share of signals for which the same atoms were picked."""
    same = float(((theirs != 0) == (found != 0)).all(axis=1).mean())
    if same < 0.95:
        raise ArithmeticError(f"supports differ in {1 - same:.1%} of the signals, expected at most 5 %")
    return same
