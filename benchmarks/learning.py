"""Dictionary learning, two threads, against scikit-learn and spams at the same held-out objective."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.data import N_PLACES, load_images
from benchmarks.harness import Comparison, Settings, interleaved_s, threads, version
from depthprint import learn_dictionary
from depthprint.dictionary_learning import l1_objective

__all__ = ["NAMES", "run"]

NAMES = ("learn_sklearn", "learn_spams")
N_ATOMS = 256
BATCH = 256
LAMBDA = 0.1  # of signals of norm 1
PASSES = 1
_WITHIN = 1.01
_PEERS = {
    "learn_sklearn": ("MiniBatchDictionaryLearning", "scikit-learn"),
    "learn_spams": ("spams.trainDL", "spams-bin"),
}


def run(settings: Settings, wanted: set[str]) -> list[Comparison]:
    """The rows asked for; a row is refused where our objective is over 1.01 times the peer's."""
    train, held_out = _signals(settings)
    makers = {"learn_sklearn": _scikit_learn, "learn_spams": _spams}
    names = [name for name in NAMES if name in wanted]
    atoms: dict[str, npt.NDArray[Any]] = {}

    def keep(name: str, learn: Callable[[], npt.NDArray[Any]]) -> Callable[[], None]:
        def learn_and_keep() -> None:
            atoms[name] = learn()

        return learn_and_keep

    contestants = {"ours": keep("ours", lambda: _ours(train))}
    notes = {}
    for name in names:
        try:
            contestants[name] = keep(name, makers[name](train, settings.threads))
        except ImportError as error:
            notes[name] = f"no ready-made wheel for this Python: {error}"
    with threads(settings.threads), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # peers warn of early stops of their lasso
        _ours(train[: 2 * N_ATOMS])  # compiled or loaded before the clock starts
        taken = interleaved_s(contestants, rounds=1 if settings.quick else 5, warm=False)
        reached = {name: l1_objective(held_out, _unit(found), LAMBDA) for name, found in atoms.items()}
    return [_row(name, train, taken, reached, notes, settings) for name in names]


def _row(
    name: str,
    train: npt.NDArray[Any],
    taken: dict[str, float],
    reached: dict[str, float],
    notes: dict[str, str],
    settings: Settings,
) -> Comparison:
    extra = {}
    if name in reached:
        extra = {"held_out_objective_ours": reached["ours"], "held_out_objective_peer": reached[name]}
        if reached["ours"] > _WITHIN * reached[name]:
            notes[name] = (
                f"our objective is {reached['ours'] / reached[name]:.3f} times theirs: not comparable"
            )
    size = f"{train.shape[0]} x {train.shape[1]}, {N_ATOMS} atoms, batches of {BATCH}, {PASSES} pass"
    peer, package = _PEERS[name]
    return Comparison(
        name, taken["ours"], taken.get(name), peer, version(package), settings.threads, size, "learning",
        notes.get(name, ""), extra,
    )  # fmt: skip


def _signals(settings: Settings) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Images of the drive, each less its mean and of norm 1: some to train on, and others held out."""
    x = load_images(300 if settings.quick else N_PLACES).astype(np.float64)
    if settings.quick:
        x = np.concatenate([x, x[:, ::-1], -x])  # enough directions for 256 atoms
    x -= x.mean(axis=1, keepdims=True)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    order = np.random.default_rng(0).permutation(len(x))
    n = 600 if settings.quick else 2000
    return x[order[:n]], x[order[n : n + 400]]


def _ours(train: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
    learned = learn_dictionary(train, N_ATOMS, lambda_=LAMBDA, batch_size=BATCH, n_passes=PASSES, seed=0)
    return np.asarray(learned.atoms)


def _scikit_learn(train: npt.NDArray[np.float64], n: int) -> Callable[[], npt.NDArray[Any]]:
    from sklearn.decomposition import MiniBatchDictionaryLearning

    def learn() -> npt.NDArray[Any]:
        learner = MiniBatchDictionaryLearning(
            N_ATOMS, alpha=LAMBDA, batch_size=BATCH, max_iter=PASSES, fit_algorithm="cd", n_jobs=n,
            random_state=0, tol=0, max_no_improvement=None,
        )  # fmt: skip
        return np.asarray(learner.fit(train).components_)

    return learn


def _spams(train: npt.NDArray[np.float64], n: int) -> Callable[[], npt.NDArray[Any]]:
    import spams

    columns = np.asfortranarray(train.T)
    batches = PASSES * -(-len(train) // BATCH)

    def learn() -> npt.NDArray[Any]:
        return np.asarray(
            spams.trainDL(
                columns, K=N_ATOMS, lambda1=LAMBDA, iter=batches, batchsize=BATCH, numThreads=n, verbose=False
            ).T
        )

    return learn


def _unit(atoms: npt.NDArray[Any]) -> npt.NDArray[Any]:
    norms = np.linalg.norm(atoms, axis=1)
    return np.asarray(atoms[norms > 0] / norms[norms > 0, None])
