"""Learned dictionaries against scikit-learn and spams, and what every learner must keep."""

from __future__ import annotations

import warnings

import numba
import numpy as np
import pytest
from sklearn.decomposition import MiniBatchDictionaryLearning, sparse_encode

from depthprint.dictionary_learning import l1_objective, learn_dictionary, random_patches_dictionary
from depthprint.errors import DataError, SettingsError
from depthprint.sparse_coding import sparse_code

LAMBDA = 0.2
N_ATOMS = 48


def smooth_patches(n, size=6, seed=0):
    """Simulated depth patches: a slanted plane, often cut by a step, with noise; norm 1."""
    rng = np.random.default_rng(seed)
    y, x = (np.mgrid[0:size, 0:size] - (size - 1) / 2) / size
    angle, place, slope = rng.uniform(0, 2 * np.pi, n), rng.normal(0, 0.3, n), rng.normal(0, 1, (n, 2))
    side = np.cos(angle)[:, None, None] * x + np.sin(angle)[:, None, None] * y > place[:, None, None]
    patches = slope[:, :1, None] * x + slope[:, 1:, None] * y + 2 * side * rng.standard_normal((n, 1, 1))
    patches = (patches + 0.05 * rng.standard_normal(patches.shape)).reshape(n, -1)
    patches -= patches.mean(axis=1, keepdims=True)
    return patches / np.linalg.norm(patches, axis=1, keepdims=True)


def scikit_learn_atoms(signals, n_passes, batch_size):
    learner = MiniBatchDictionaryLearning(
        N_ATOMS,
        alpha=LAMBDA,
        batch_size=batch_size,
        max_iter=n_passes,
        random_state=0,
        tol=0,
        max_no_improvement=None,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its LARS warns of early stops and of its own deprecations
        atoms = learner.fit(signals).components_
    return atoms / np.linalg.norm(atoms, axis=1, keepdims=True)


def spams_atoms(signals, n_passes, batch_size):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # raised when its extension module is imported
        spams = pytest.importorskip("spams")
        atoms = spams.trainDL(
            np.asfortranarray(signals.T),
            K=N_ATOMS,
            lambda1=LAMBDA,
            iter=n_passes * -(-len(signals) // batch_size),
            batchsize=batch_size,
            numThreads=1,
            verbose=False,
        ).T
    norms = np.linalg.norm(atoms, axis=1, keepdims=True)
    return (atoms / np.where(norms > 0, norms, 1))[norms[:, 0] > 0]


@pytest.mark.parametrize("peer", [scikit_learn_atoms, spams_atoms])
@pytest.mark.parametrize("n_passes", [1, 3])
def test_objective_reaches_the_peers_within_one_percent(peer, n_passes):
    signals, held_out = smooth_patches(640), smooth_patches(400, seed=1)
    theirs = peer(signals, n_passes, 64)
    ours = learn_dictionary(signals, N_ATOMS, lambda_=LAMBDA, batch_size=64, n_passes=n_passes)
    for data in (signals, held_out):
        assert l1_objective(data, ours, LAMBDA) <= 1.01 * l1_objective(data, theirs, LAMBDA)


def test_objective_equals_scikit_learns_lasso():
    signals = smooth_patches(100)
    atoms = random_patches_dictionary(signals, 60).atoms
    for weight in (0.5, 0.1, 0.01):
        codes = sparse_encode(
            signals, atoms, algorithm="lasso_cd", alpha=weight, max_iter=100_000, check_input=False
        )
        expected = (0.5 * np.square(signals - codes @ atoms).sum() + weight * np.abs(codes).sum()) / len(
            signals
        )
        assert l1_objective(signals, atoms, weight) == pytest.approx(expected, rel=1e-4)
        assert l1_objective(signals, atoms, weight) <= expected * (1 + 1e-9)


def test_objective_copes_with_repeated_and_opposite_atoms():
    signals = smooth_patches(60)
    atoms = random_patches_dictionary(signals, 30).atoms
    doubled = np.vstack([atoms, -atoms, atoms])
    assert l1_objective(signals, doubled, 0.1) == pytest.approx(l1_objective(signals, atoms, 0.1), rel=1e-9)


def test_objective_at_large_lambda_is_half_the_energy():
    signals = smooth_patches(50)
    assert l1_objective(signals, random_patches_dictionary(signals, 20), 2.0) == pytest.approx(0.5)


@pytest.mark.parametrize("penalty", ["l1", "omp"])
def test_learning_beats_random_patches_on_held_out_signals(penalty):
    signals, held_out = smooth_patches(1500), smooth_patches(400, seed=1)
    learned = learn_dictionary(signals, N_ATOMS, penalty=penalty, lambda_=LAMBDA, n_nonzero=3, batch_size=128)
    drawn = random_patches_dictionary(signals, N_ATOMS)
    if penalty == "l1":
        assert l1_objective(held_out, learned, LAMBDA) < 0.98 * l1_objective(held_out, drawn, LAMBDA)
    else:
        left = [
            np.square(sparse_code(held_out, d, n_nonzero=3).residual_norms).mean() for d in (learned, drawn)
        ]
        assert left[0] < 0.9 * left[1]


def test_more_passes_do_not_hurt():
    signals = smooth_patches(800)
    values = [
        l1_objective(
            signals, learn_dictionary(signals, N_ATOMS, lambda_=LAMBDA, batch_size=64, n_passes=p), LAMBDA
        )
        for p in (1, 4, 10)
    ]
    assert values[0] > values[1] > values[2]


def test_atoms_that_made_the_signals_are_found_again():
    rng = np.random.default_rng(5)
    truth = rng.standard_normal((20, 30))
    truth /= np.linalg.norm(truth, axis=1, keepdims=True)
    codes = np.zeros((3000, 20))
    for row in codes:
        row[rng.choice(20, 2, replace=False)] = rng.choice([-1, 1], 2) * rng.uniform(1, 2, 2)
    learned = learn_dictionary(codes @ truth, 20, lambda_=0.1, batch_size=100, n_passes=8)
    best = np.abs(learned.atoms @ truth.T).max(axis=0)
    assert np.median(best) > 0.99


@pytest.mark.parametrize("penalty", ["l1", "omp"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_bits_depend_on_the_seed_and_not_on_threads(penalty, dtype):
    signals = smooth_patches(500).astype(dtype)

    def learn(threads, seed=0):
        numba.set_num_threads(threads)
        return learn_dictionary(
            signals, N_ATOMS, penalty=penalty, n_nonzero=3, n_passes=2, batch_size=200, seed=seed
        )

    before = numba.get_num_threads()
    try:
        most = min(2, numba.config.NUMBA_NUM_THREADS)
        one, two, again, other = learn(1), learn(most), learn(most), learn(most, seed=1)
    finally:
        numba.set_num_threads(before)
    assert one.atoms.tobytes() == two.atoms.tobytes() == again.atoms.tobytes()
    assert one.fingerprint == two.fingerprint != other.fingerprint
    np.testing.assert_allclose(np.linalg.norm(one.atoms, axis=1), 1, atol=1e-12)


def test_scaling_the_signals_by_a_power_of_two_leaves_the_atoms():
    signals = smooth_patches(400)
    small, large = (learn_dictionary(s * signals, 24, n_passes=1) for s in (0.25, 1024.0))
    np.testing.assert_allclose(small.atoms, large.atoms, atol=1e-12)
    assert large.settings["lambda_"] == pytest.approx(4096 * small.settings["lambda_"])


def test_unused_atoms_are_replaced():
    # Half the signals lie along one direction: atoms beyond it are needed only for the others.
    rng = np.random.default_rng(0)
    rare = smooth_patches(60)
    common = np.outer(rng.uniform(1, 2, 800), rare[0]) + 1e-3 * rng.standard_normal((800, 36))
    learned = learn_dictionary(np.vstack([common, rare]), 40, lambda_=0.1, batch_size=50, n_passes=6)
    codes = sparse_code(rare, learned, n_nonzero=5)
    assert len(np.unique(codes.indices)) > 20
    assert np.isfinite(learned.atoms).all()


def test_random_patches_are_signals_and_differ():
    signals = np.vstack([smooth_patches(30), -2 * smooth_patches(30), np.zeros((5, 36))])
    atoms = random_patches_dictionary(signals, 30).atoms
    np.testing.assert_allclose(np.abs(atoms @ smooth_patches(30).T).max(axis=1), 1, atol=1e-12)
    off_diagonal = np.abs(atoms @ atoms.T) - np.eye(30)
    assert off_diagonal.max() < 1 - 1e-9
    with pytest.raises(DataError, match=r"at least 31 .* got 30 among 65"):
        random_patches_dictionary(signals, 31)


@pytest.mark.parametrize(
    "signals", [smooth_patches(10), np.repeat(smooth_patches(10), 20, axis=0), np.zeros((50, 36))]
)
def test_too_few_distinct_signals_are_refused(signals):
    with pytest.raises(DataError, match="differ in direction"):
        learn_dictionary(signals, 11)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"penalty": "l2"}, "l1, omp"),
        ({"lambda_": 0.0}, "> 0"),
        ({"lambda_": float("nan")}, "> 0"),
        ({"n_passes": 0}, "n_passes"),
        ({"batch_size": 0}, "batch_size"),
        ({"n_atoms": 0}, "n_atoms"),
        ({"n_nonzero": 0}, "n_nonzero"),
    ],
)
def test_wrong_settings_are_refused(options, message):
    with pytest.raises(SettingsError, match=message):
        learn_dictionary(smooth_patches(50), **{"n_atoms": 10, **options})


def test_wrong_signals_are_refused():
    signals = smooth_patches(50)
    signals[7, 3] = np.nan
    with pytest.raises(DataError, match="row 7"):
        learn_dictionary(signals, 10)
    with pytest.raises(DataError, match=r"\(n, d\)"):
        learn_dictionary(signals[0], 10)
    with pytest.raises(DataError, match="float32 or float64"):
        learn_dictionary(np.ones((50, 4), dtype=int), 10)
    with pytest.raises(DataError, match=r"\(n, 5\)"):
        l1_objective(smooth_patches(5), np.eye(5), 0.1)


def test_progress_reaches_the_total():
    seen = []
    learn_dictionary(smooth_patches(90), 10, n_passes=2, batch_size=40, progress=lambda *at: seen.append(at))
    assert seen == [(40, 180), (80, 180), (90, 180), (130, 180), (170, 180), (180, 180)]
