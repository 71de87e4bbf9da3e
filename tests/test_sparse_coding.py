"""Pursuits against slow references, scikit-learn, and what theory promises."""

from __future__ import annotations

import warnings

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.linear_model import orthogonal_mp, orthogonal_mp_gram

from depthprint.dictionary import Dictionary
from depthprint.errors import DataError, SettingsError
from depthprint.sparse_coding import ALGORITHMS, SparseModel, sparse_code


def random_atoms(n_atoms, dimension, seed=0):
    atoms = np.random.default_rng(seed).standard_normal((n_atoms, dimension))
    return atoms / np.linalg.norm(atoms, axis=1, keepdims=True)


def random_signals(n, dimension, seed=1):
    return np.random.default_rng(seed).standard_normal((n, dimension))


def project(signal, atoms, picked):
    coefficients, *_ = np.linalg.lstsq(atoms[picked].T, signal, rcond=None)
    return coefficients, signal - coefficients @ atoms[picked]


def slow_omp(signal, atoms, count):
    picked, residual = [], signal
    for _ in range(count):
        picked.append(int(np.argmax(np.abs(atoms @ residual))))
        coefficients, residual = project(signal, atoms, picked)
    return picked, coefficients


def slow_ols(signal, atoms, count):
    picked = []
    for _ in range(count):
        left = [np.inf if j in picked else np.linalg.norm(project(signal, atoms, [*picked, j])[1])
                for j in range(len(atoms))]  # fmt: skip
        picked.append(int(np.argmin(left)))
    return picked, project(signal, atoms, picked)[0]


def slow_mp(signal, atoms, steps):
    dense, residual = np.zeros(len(atoms)), signal.copy()
    for _ in range(steps):
        correlations = atoms @ residual
        best = int(np.argmax(np.abs(correlations)))
        dense[best] += correlations[best]
        residual = residual - correlations[best] * atoms[best]
    return dense, np.linalg.norm(residual)


@pytest.mark.parametrize(
    ("n_atoms", "dimension", "count"), [(256, 64, 4), (100, 150, 20), (300, 40, 12), (7, 3, 3)]
)
def test_omp_equals_scikit_learn(n_atoms, dimension, count):
    atoms, signals = random_atoms(n_atoms, dimension), random_signals(60, dimension)
    model = sparse_code(signals, atoms, n_nonzero=count)
    gram, correlations = atoms @ atoms.T, atoms @ signals.T
    by_gram = orthogonal_mp_gram(gram, correlations, n_nonzero_coefs=count).T.reshape(60, n_atoms)
    by_qr = orthogonal_mp(atoms.T, signals.T, n_nonzero_coefs=count).T.reshape(60, n_atoms)
    np.testing.assert_array_equal(model.to_dense() != 0, by_gram != 0)
    np.testing.assert_allclose(model.to_dense(), by_gram, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(model.to_dense(), by_qr, rtol=1e-7, atol=1e-9)


def test_omp_with_a_tolerance_equals_scikit_learn():
    atoms, signals = random_atoms(120, 50), random_signals(40, 50)
    model = sparse_code(signals, atoms, n_nonzero=None, residual_tolerance=2.5)
    squared = np.square(signals).sum(axis=1)
    expected = orthogonal_mp_gram(
        atoms @ atoms.T, atoms @ signals.T, tol=2.5**2, norms_squared=squared.copy(), copy_Xy=True
    ).T
    np.testing.assert_allclose(model.to_dense(), expected, rtol=1e-7, atol=1e-9)
    assert (model.residual_norms <= 2.5).all()
    assert len(set(np.diff(model.indptr))) > 1


@pytest.mark.parametrize(("algorithm", "reference"), [("omp", slow_omp), ("ols", slow_ols)])
def test_picks_and_their_order_equal_a_slow_reference(algorithm, reference):
    atoms, signals = random_atoms(60, 24), random_signals(25, 24)
    model = sparse_code(signals, atoms, algorithm=algorithm, n_nonzero=6)
    for i, signal in enumerate(signals):
        picked, coefficients = reference(signal, atoms, 6)
        assert model.row(i)[0].tolist() == picked
        np.testing.assert_allclose(model.row(i)[1], coefficients, rtol=1e-8, atol=1e-10)


def test_matching_pursuit_equals_a_slow_reference_with_atoms_picked_again():
    atoms, signals = random_atoms(30, 12), random_signals(25, 12)
    model = sparse_code(signals, atoms, algorithm="mp", n_nonzero=25)
    for i, signal in enumerate(signals):
        dense, left = slow_mp(signal, atoms, 25)
        np.testing.assert_allclose(model.to_dense()[i], dense, rtol=1e-8, atol=1e-12)
        assert model.residual_norms[i] == pytest.approx(left, rel=1e-8)
    assert (np.diff(model.indptr) < 25).any()


def test_ols_leaves_no_more_than_omp_after_two_atoms_on_average_and_never_at_one():
    atoms, signals = random_atoms(200, 30), random_signals(200, 30)
    one = [sparse_code(signals, atoms, algorithm=a, n_nonzero=1) for a in ("omp", "ols")]
    np.testing.assert_array_equal(one[0].indices, one[1].indices)
    five = [
        sparse_code(signals, atoms, algorithm=a, n_nonzero=5).residual_norms.mean() for a in ("omp", "ols")
    ]
    assert five[1] < five[0]


@pytest.mark.parametrize("algorithm", ["omp", "ols"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_sparse_signals_are_recovered_from_an_incoherent_dictionary(algorithm, dtype):
    # Identity and Hadamard: coherence 1/16, so any 8 atoms are recovered (Tropp 2004).
    from scipy.linalg import hadamard

    atoms = np.vstack([np.eye(256), hadamard(256) / 16.0])
    rng = np.random.default_rng(3)
    truth = np.zeros((40, 512))
    for row in truth:
        row[rng.choice(512, 8, replace=False)] = rng.choice([-1, 1], 8) * rng.uniform(1, 2, 8)
    model = sparse_code((truth @ atoms).astype(dtype), atoms, algorithm=algorithm, n_nonzero=20)
    assert model.coefficients.dtype == dtype
    np.testing.assert_array_equal(model.to_dense() != 0, truth != 0)
    np.testing.assert_allclose(model.to_dense(), truth, atol=1e-4 if dtype == np.float32 else 1e-12)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n_atoms=st.integers(1, 40),
    dimension=st.integers(1, 20),
    count=st.integers(1, 25),
    algorithm=st.sampled_from(["omp", "ols"]),
    scale=st.sampled_from([1e-6, 1.0, 1e6]),
)
def test_residual_is_orthogonal_to_the_picked_atoms(seed, n_atoms, dimension, count, algorithm, scale):
    atoms, signals = random_atoms(n_atoms, dimension, seed), scale * random_signals(5, dimension, seed + 1)
    model = sparse_code(signals, atoms, algorithm=algorithm, n_nonzero=count)
    residuals = signals - model.reconstruct(atoms)
    np.testing.assert_allclose(np.linalg.norm(residuals, axis=1), model.residual_norms, atol=1e-9 * scale)
    for i in range(5):
        picked, _ = model.row(i)
        assert len(set(picked.tolist())) == len(picked) <= min(count, n_atoms, dimension)
        norm = np.linalg.norm(signals[i])
        assert np.abs(atoms[picked] @ residuals[i]).max(initial=0) <= 1e-6 * norm
        assert model.residual_norms[i] <= norm * (1 + 1e-9)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_single_precision_agrees_with_double(algorithm):
    atoms, signals = random_atoms(100, 64), random_signals(300, 64)
    single = sparse_code(signals.astype(np.float32), atoms, algorithm=algorithm, n_nonzero=4)
    double = sparse_code(signals, atoms, algorithm=algorithm, n_nonzero=4)
    assert single.residual_norms.dtype == np.float32
    same = [np.array_equal(single.row(i)[0], double.row(i)[0]) for i in range(300)]
    assert np.mean(same) > 0.99
    np.testing.assert_allclose(single.residual_norms, double.residual_norms, rtol=1e-3)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_bits_do_not_depend_on_threads_or_on_the_batch(algorithm, dtype):
    atoms = Dictionary(random_atoms(256, 64))
    signals = random_signals(1100, 64).astype(dtype)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = sparse_code(signals, atoms, algorithm=algorithm, n_nonzero=5)
        numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))
        two = sparse_code(signals, atoms, algorithm=algorithm, n_nonzero=5)
    finally:
        numba.set_num_threads(before)
    for name in ("indptr", "indices", "coefficients", "residual_norms"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()
    alone = sparse_code(signals[777:778], atoms, algorithm=algorithm, n_nonzero=5)
    assert alone.coefficients.tobytes() == one.row(777)[1].tobytes()
    assert alone.indices.tobytes() == one.row(777)[0].tobytes()


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_zero_signals_get_empty_models(algorithm):
    signals = np.zeros((3, 10))
    signals[1] = 1.0
    model = sparse_code(signals, random_atoms(15, 10), algorithm=algorithm, n_nonzero=3)
    assert np.diff(model.indptr).tolist() == [0, 3, 0]
    assert model.residual_norms[[0, 2]].tolist() == [0, 0]
    assert (model.reconstruct(random_atoms(15, 10))[[0, 2]] == 0).all()


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_repeated_and_dependent_atoms_are_never_picked_together(algorithm, dtype):
    base = random_atoms(4, 12)
    mixed = base[0] + base[1]
    atoms = np.vstack([base, base, -base, mixed / np.linalg.norm(mixed)])
    signals = random_signals(50, 12).astype(dtype)
    model = sparse_code(signals, atoms, algorithm=algorithm, n_nonzero=10)
    assert np.isfinite(model.coefficients).all()
    best = [np.linalg.norm(project(s, base, [0, 1, 2, 3])[1]) for s in signals.astype(np.float64)]
    if algorithm != "mp":
        np.testing.assert_allclose(model.residual_norms, best, rtol=1e-4)
        assert np.diff(model.indptr).max() <= 4


def test_a_tolerance_at_or_over_the_norm_gives_an_empty_model():
    model = sparse_code(random_signals(4, 8), random_atoms(9, 8), n_nonzero=3, residual_tolerance=1e3)
    assert len(model.indices) == 0
    assert len(sparse_code(np.zeros((0, 8)), random_atoms(9, 8))) == 0


def test_more_atoms_never_leave_more():
    atoms, signals = random_atoms(128, 64), random_signals(100, 64)
    left = np.array([sparse_code(signals, atoms, n_nonzero=k).residual_norms for k in (1, 2, 4, 8, 16, 64)])
    assert (np.diff(left, axis=0) < 0).all()
    np.testing.assert_allclose(left[-1], 0, atol=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_signal_that_is_not_finite_is_named(value):
    signals = random_signals(700, 6)
    signals[600, 2] = value
    signals[650, 2] = value
    with pytest.raises(DataError, match="row 600 holds NaN or infinity"):
        sparse_code(signals, random_atoms(9, 6))


def test_a_signal_too_large_for_its_type_is_named():
    signals = np.ones((3, 6))
    signals[1] = 1e308
    with pytest.raises(DataError, match="row 1 is too large"):
        sparse_code(signals, random_atoms(9, 6))


@pytest.mark.parametrize(
    ("signals", "options", "error", "message"),
    [
        (np.ones((2, 5)), {}, DataError, r"\(n, 6\)"),
        (np.ones(6), {}, DataError, r"\(n, 6\)"),
        (np.ones((2, 6), dtype=int), {}, DataError, "float32 or float64"),
        (np.ones((2, 6)), {"algorithm": "lars"}, SettingsError, "omp, ols, mp"),
        (np.ones((2, 6)), {"n_nonzero": 0}, SettingsError, "at least 1"),
        (np.ones((2, 6)), {"residual_tolerance": -1.0}, SettingsError, ">= 0"),
        (np.ones((2, 6)), {"residual_tolerance": np.nan}, SettingsError, ">= 0"),
        (np.ones((2, 6)), {"algorithm": "mp", "n_nonzero": None}, SettingsError, "needs a number of steps"),
    ],
)
def test_wrong_input_says_what_was_expected(signals, options, error, message):
    with pytest.raises(error, match=message):
        sparse_code(signals, random_atoms(9, 6), **options)


def test_model_rows_and_their_limits():
    model = sparse_code(random_signals(3, 6), random_atoms(9, 6), n_nonzero=2)
    assert model.row(-1)[0].tolist() == model.row(2)[0].tolist()
    with pytest.raises(IndexError, match="3 rows"):
        model.row(3)
    with pytest.raises(DataError, match="9 atoms, got 8"):
        model.reconstruct(random_atoms(8, 6))
    with pytest.raises(ValueError, match="read-only"):
        model.coefficients[0] = 1
    with pytest.raises(DataError, match=r"0\.\.1"):
        SparseModel(np.array([0, 1]), np.array([5], dtype=np.int32), np.ones(1), np.ones(1), 2)


def test_progress_reaches_the_total_in_order():
    seen = []
    sparse_code(
        random_signals(600, 6), random_atoms(9, 6), progress=lambda done, total: seen.append((done, total))
    )
    assert seen == sorted(seen)
    assert seen[-1] == (600, 600)


def test_real_depth_patches_are_coded_as_scikit_learn_codes_them(data_root):
    cv2 = pytest.importorskip("cv2")
    frames = sorted((data_root / "rgbd" / "redkitchen_seq01").glob("*depth*.png"))
    if not frames:
        pytest.skip("the RedKitchen depth frames are absent")
    depth = cv2.imread(str(frames[0]), cv2.IMREAD_UNCHANGED).astype(np.float64)[::4, ::4] / 1000
    depth[depth > 60] = 0
    windows = np.lib.stride_tricks.sliding_window_view(depth, (8, 8))[::4, ::4].reshape(-1, 64)
    patches = windows[(windows > 0).all(axis=1)]
    patches = patches - patches.mean(axis=1, keepdims=True)
    patches = patches[np.linalg.norm(patches, axis=1) > 0.05]
    atoms = random_atoms(128, 64)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        expected = orthogonal_mp_gram(atoms @ atoms.T, atoms @ patches.T, n_nonzero_coefs=5).T
    np.testing.assert_allclose(sparse_code(patches, atoms, n_nonzero=5).to_dense(), expected, atol=1e-9)
