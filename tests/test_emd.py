from __future__ import annotations

import numpy as np
import ot
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from depthprint._matrix_tasks import row_tasks
from depthprint.emd import (
    _PAIRS_WORTH_THREADS,
    difference_matrix,
    emd,
    emd_from_costs,
    emd_pairs,
    emd_pairs_from_costs,
)
from depthprint.errors import DataError, FingerprintError, SettingsError
from depthprint.ncd import FORMS
from depthprint.signature import GroundDistance, Signature, SignatureBatch


def random_signature(rng: np.random.Generator, k: int, d: int = 4, spread: float = 0.7) -> Signature:
    weights = rng.random(k) * (rng.random(k) > 0.1)
    weights[:1] += 0.1
    return Signature(weights, spread * rng.normal(size=(k, d)), "model")


def random_problem(rng: np.random.Generator, largest: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights with zeros and ties, costs with equal points, ties and zeros; masses are unequal."""
    m, n = rng.integers(1, largest + 1, 2)
    p = rng.random(m) if rng.random() < 0.5 else rng.integers(0, 4, m).astype(float)
    q = rng.random(n) if rng.random() < 0.5 else rng.integers(0, 4, n).astype(float)
    p[rng.random(m) < 0.1] = 0
    q[rng.random(n) < 0.1] = 0
    p[rng.integers(m)] += 0.5
    q[rng.integers(n)] += 0.5
    kind = rng.integers(3)
    if kind == 0:
        costs = rng.random((m, n))
    elif kind == 1:
        costs = rng.integers(0, 4, (m, n)).astype(float)
    else:
        x, y = rng.integers(0, 3, (m, 2)).astype(float), rng.integers(0, 3, (n, 2)).astype(float)
        costs = np.linalg.norm(x[:, None] - y[None], axis=2)
    return p, q, costs


def with_null(p: np.ndarray, q: np.ndarray, costs: np.ndarray, null_cost: float):
    """The same problem as a balanced one: the lighter side gets the null element."""
    surplus = p.sum() - q.sum()
    if surplus > 0:
        return p, np.append(q, surplus), np.column_stack([costs, np.full(len(p), null_cost)])
    return np.append(p, -surplus), q, np.vstack([costs, np.full(len(q), null_cost)])


def pot_value(p: np.ndarray, q: np.ndarray, costs: np.ndarray) -> float:
    total = p.sum()
    return total * float(ot.emd2(p / total, q / q.sum(), np.ascontiguousarray(costs), numItermax=10**7))


def lp_value(p: np.ndarray, q: np.ndarray, costs: np.ndarray) -> float:
    """Eq. 11-16: work of the cheapest flow of min(total weights)."""
    m, n = costs.shape
    rows = np.kron(np.eye(m), np.ones(n))
    columns = np.kron(np.ones(m), np.eye(n))
    scale = max(p.sum(), q.sum())
    solution = linprog(
        costs.ravel(),
        A_ub=np.vstack([rows, columns]),
        b_ub=np.concatenate([p, q]) / scale,
        A_eq=np.ones((1, m * n)),
        b_eq=[min(p.sum(), q.sum()) / scale],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    assert solution.status == 0, solution.message
    return float(solution.fun) * scale


def check_against_oracles(seed: int, largest: int, count: int, lp_largest: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(count):
        p, q, costs = random_problem(rng, largest)
        null = emd_from_costs(p, q, costs, masses="null", null_cost=2.0).value
        scale = max(p.sum(), q.sum()) * max(costs.max(), 1e-3)
        assert null == pytest.approx(pot_value(*with_null(p, q, costs, 2.0)), rel=1e-9, abs=1e-13 * scale)
        balanced = emd_from_costs(p, q, costs, masses="balanced").value
        expected = pot_value(p / p.sum(), q / q.sum(), costs)
        assert balanced == pytest.approx(expected, rel=1e-9, abs=1e-13 * scale)
        rubner = emd_from_costs(p, q, costs, masses="rubner")
        assert rubner.work == pytest.approx(
            pot_value(*with_null(p, q, costs, 0.0)), rel=1e-9, abs=1e-13 * scale
        )
        if max(costs.shape) <= lp_largest:
            assert rubner.work == pytest.approx(lp_value(p, q, costs), rel=1e-9, abs=1e-12 * scale)


def test_equals_pot_and_linear_programming() -> None:
    check_against_oracles(seed=1, largest=40, count=150, lp_largest=15)
    check_against_oracles(seed=2, largest=130, count=10, lp_largest=0)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(4))
def test_equals_pot_and_linear_programming_on_ten_thousand_problems(part: int) -> None:
    check_against_oracles(seed=100 + part, largest=130, count=2500, lp_largest=20)


def test_flow_is_feasible_and_explains_the_work() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        p, q, costs = random_problem(rng, 30)
        result = emd_from_costs(p, q, costs, masses="null", null_cost=2.0, return_flow=True)
        assert result.flow is not None
        assert (result.flow >= 0).all()
        assert (result.flow.sum(axis=1) <= p + 1e-12).all()
        assert (result.flow.sum(axis=0) <= q + 1e-12).all()
        assert result.flow.sum() == pytest.approx(result.flow_mass)
        assert result.surplus == pytest.approx(p.sum() - q.sum(), abs=1e-12)
        assert (result.flow * costs).sum() + 2.0 * abs(result.surplus) == pytest.approx(result.work)
        with pytest.raises(ValueError, match="read-only"):
            result.flow[0, 0] = 1


def test_rubner_divides_the_work_by_the_flow() -> None:
    result = emd_from_costs([2.0, 1.0], [1.0], [[0.5], [0.25]], masses="rubner")
    assert (result.value, result.work, result.flow_mass, result.surplus) == (0.25, 0.25, 1.0, 2.0)


def test_surplus_goes_to_the_null_element() -> None:
    p = Signature([1.0, 0.5], [[0.0], [10.0]])
    q = Signature([1.0], [[0.25]])
    assert emd(p, q).value == pytest.approx(0.25 + 0.5)
    assert emd(p, q, ground=GroundDistance(null_cost=3.0, cap=6.0)).value == pytest.approx(0.25 + 1.5)


def test_distance_to_the_empty_signature_is_its_mass() -> None:
    rng = np.random.default_rng(0)
    p, empty = random_signature(rng, 7), Signature(np.zeros(0), np.zeros((0, 4)), "model")
    weightless = Signature(np.zeros(2), np.ones((2, 4)), "model")
    for null in (empty, weightless):
        assert emd(p, null, ground=GroundDistance(null_cost=2.0)).value == pytest.approx(2 * p.mass)
        assert emd(null, p).value == pytest.approx(p.mass)
        for masses in ("null", "rubner", "balanced"):
            assert emd(null, empty, masses=masses).value == 0
        for masses in ("rubner", "balanced"):
            with pytest.raises(DataError, match="empty"):
                emd(p, null, masses=masses)


def test_shift_moves_positions_and_period_wraps_them() -> None:
    p, q = Signature([1.0], [[0.5, 9.5, 1.0]]), Signature([1.0], [[0.5, 0.5, 1.0]])
    flat = GroundDistance(cap=20, null_cost=10, position_dims=2)
    circular = GroundDistance(cap=20, null_cost=10, position_dims=2, period=10.0)
    assert emd(p, q, ground=flat).value == pytest.approx(9)
    assert emd(p, q, ground=circular).value == pytest.approx(1)
    assert emd(p, q, ground=circular, shift=[1.0, 0.0]).value == pytest.approx(0, abs=1e-12)
    assert emd(p, q, ground=flat, shift=[-9.0, 2.0]).value == pytest.approx(2)


def test_cap_limits_the_ground_distance() -> None:
    p, q = Signature([1.0], [[0.0]]), Signature([1.0], [[5.0]])
    assert emd(p, q).value == 2.0
    assert emd(p, q, ground=GroundDistance(cap=1.5)).value == 1.5


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), sizes=st.tuples(*[st.integers(0, 8)] * 3), scale=st.floats(1e-3, 1e3))
def test_null_emd_is_a_metric_on_unequal_masses(seed: int, sizes: tuple[int, int, int], scale: float) -> None:
    rng = np.random.default_rng(seed)
    x, y, z = (random_signature(rng, k) for k in sizes)
    x = Signature(x.weights * scale, x.points, "model")
    xy, yz, xz = emd(x, y).value, emd(y, z).value, emd(x, z).value
    assert emd(x, x).value == 0
    assert xy == pytest.approx(emd(y, x).value, rel=1e-12)
    assert xy >= abs(x.mass - y.mass) * (1 - 1e-12)
    assert xy <= (x.mass + y.mass) * (1 + 1e-12)
    assert xz <= (xy + yz) * (1 + 1e-12)
    if not np.array_equal(x.weights[x.weights > 0], y.weights[y.weights > 0]):
        assert xy > 0


def test_matrix_equals_pairs_in_every_mode() -> None:
    rng = np.random.default_rng(5)
    signatures = [random_signature(rng, k) for k in (3, 1, 12, 7, 25, 4)]
    batch, other = SignatureBatch.stack(signatures), SignatureBatch.stack(signatures[::-1][:4])
    for ground in (GroundDistance(), GroundDistance(cap=1.5, position_dims=2, period=1.0)):
        for masses in ("null", "rubner", "balanced"):
            pairs = np.array(
                [[emd(x, y, masses=masses, ground=ground).value for y in signatures] for x in signatures]
            )
            matrix = difference_matrix(batch, masses=masses, ground=ground)
            np.testing.assert_allclose(matrix, pairs, rtol=1e-12, atol=1e-14)
            np.testing.assert_array_equal(matrix, matrix.T)
            crossed = difference_matrix(batch, other, masses=masses, ground=ground)
            np.testing.assert_allclose(crossed, pairs[:, ::-1][:, :4], rtol=1e-12, atol=1e-14)
            k = np.array([s.mass if masses == "null" else 1.0 for s in signatures])
            for form, formula in FORMS.items():
                ncd = difference_matrix(batch, masses=masses, ground=ground, form=form)
                np.testing.assert_allclose(ncd, formula(pairs, k[:, None], k[None]), rtol=1e-12, atol=1e-14)


def test_matrix_takes_the_least_over_shifts() -> None:
    rng = np.random.default_rng(6)
    batch = SignatureBatch.stack([random_signature(rng, 6) for _ in range(7)])
    ground = GroundDistance(position_dims=2, period=2.0)
    for shifts in (np.array([[0.0, 0.0], [0.3, 0.1], [-0.5, 0.0]]), np.array([[-0.2, 0.0], [0.2, 0.0]])):
        expected = np.min(
            [
                [
                    [emd(x, y, ground=ground, shift=s).value for y in iter_batch(batch)]
                    for x in iter_batch(batch)
                ]
                for s in shifts
            ],
            axis=0,
        )
        np.testing.assert_allclose(
            difference_matrix(batch, ground=ground, shifts=shifts), expected, rtol=1e-12, atol=1e-14
        )


def iter_batch(batch: SignatureBatch) -> list[Signature]:
    return [batch[i] for i in range(len(batch))]


def test_below_keeps_exactly_what_is_under_it() -> None:
    rng = np.random.default_rng(7)
    batch = SignatureBatch.stack([random_signature(rng, 5, spread=0.2) for _ in range(30)])
    full = difference_matrix(batch, form="steinhaus")
    threshold = float(np.median(full))
    cut = difference_matrix(batch, form="steinhaus", below=threshold)
    np.testing.assert_array_equal(cut, np.where(full <= threshold, full, np.inf))


def test_result_does_not_depend_on_threads_or_order() -> None:
    import numba

    rng = np.random.default_rng(8)
    signatures = [random_signature(rng, int(k)) for k in rng.integers(1, 20, 40)]
    order = rng.permutation(len(signatures))
    threads = numba.get_num_threads()
    first = difference_matrix(SignatureBatch.stack(signatures), SignatureBatch.stack(signatures))
    try:
        numba.set_num_threads(1)
        alone = difference_matrix(SignatureBatch.stack(signatures), SignatureBatch.stack(signatures))
    finally:
        numba.set_num_threads(threads)
    shuffled = SignatureBatch.stack([signatures[i] for i in order])
    np.testing.assert_array_equal(first, alone)
    np.testing.assert_array_equal(first[np.ix_(order, order)], difference_matrix(shuffled, shuffled))


def test_few_pairs_on_the_calling_thread_are_those_of_the_whole_matrix() -> None:
    rng = np.random.default_rng(18)
    batch = SignatureBatch.stack([random_signature(rng, int(k)) for k in rng.integers(1, 20, 12)])
    few = SignatureBatch.stack([batch[k] for k in range(4)])
    whole = difference_matrix(batch, batch, form="information")
    assert whole.size > _PAIRS_WORTH_THREADS >= len(few) * len(batch)
    np.testing.assert_array_equal(difference_matrix(few, batch, form="information"), whole[:4])


def test_matrix_with_empty_signatures() -> None:
    rng = np.random.default_rng(9)
    empty = Signature(np.zeros(0), np.zeros((0, 4)), "model")
    signatures = [random_signature(rng, 4), empty, random_signature(rng, 5), empty]
    batch = SignatureBatch.stack(signatures)
    matrix = difference_matrix(batch)
    np.testing.assert_allclose(matrix[1], [signatures[0].mass, 0, signatures[2].mass, 0])
    for masses in ("null", "rubner", "balanced"):
        for form in FORMS:
            np.testing.assert_array_equal(difference_matrix(batch, masses=masses, form=form)[1], [1, 0, 1, 0])
    with pytest.raises(DataError, match="signature 1 of the first batch is empty"):
        difference_matrix(batch, masses="balanced")


def test_progress_reaches_the_total() -> None:
    rng = np.random.default_rng(10)
    batch = SignatureBatch.stack([random_signature(rng, 3) for _ in range(120)])
    seen: list[tuple[int, int]] = []
    difference_matrix(batch, progress=lambda done, total: seen.append((done, total)))
    assert len(seen) > 1
    assert seen[-1] == (7260, 7260)


def test_refuses_what_cannot_be_compared() -> None:
    p = Signature([1.0], [[0.0]], "a")
    with pytest.raises(FingerprintError, match="'a' and 'b'"):
        emd(p, Signature([1.0], [[0.0]], "b"))
    with pytest.raises(DataError, match="dimension, got 1 and 2"):
        emd(p, Signature([1.0], [[0.0, 1.0]], "a"))
    with pytest.raises(DataError, match="position"):
        emd(p, p, ground=GroundDistance(position_dims=2))
    with pytest.raises(SettingsError, match="masses"):
        emd(p, p, masses="heavy")  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="form"):
        difference_matrix(SignatureBatch.stack([p]), form="round")  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="shifts"):
        emd(p, p, shift=[1.0])
    with pytest.raises(DataError, match="expected costs"):
        emd_from_costs([1.0], [1.0], [[1.0, 2.0]])
    with pytest.raises(DataError, match="finite"):
        emd_from_costs([1.0], [np.nan], [[1.0]])
    with pytest.raises(DataError, match="finite and >= 0"):
        emd_from_costs([1.0], [1.0], [[-1.0]])


def test_pairs_in_one_call_equal_pairs_one_by_one() -> None:
    rng = np.random.default_rng(11)
    first = [random_signature(rng, int(k)) for k in rng.integers(1, 12, 20)]
    second = [random_signature(rng, int(k)) for k in rng.integers(1, 12, 20)]
    x, y = SignatureBatch.stack(first), SignatureBatch.stack(second)
    ground = GroundDistance(cap=1.5, position_dims=1)
    for masses in ("null", "rubner", "balanced"):
        alone = [
            emd(p, q, masses=masses, ground=ground, shift=[0.2]).value
            for p, q in zip(first, second, strict=True)
        ]
        together = emd_pairs(x, y, masses=masses, ground=ground, shift=[0.2])
        np.testing.assert_allclose(together, alone, rtol=1e-12)
        costs = rng.random((20, x.weights.shape[1], y.weights.shape[1]))
        alone = [
            emd_from_costs(x.weights[i], y.weights[i], costs[i], masses=masses).value
            for i in range(len(costs))
        ]
        np.testing.assert_allclose(
            emd_pairs_from_costs(x.weights, y.weights, costs, masses=masses), alone, rtol=1e-12
        )
    matrix = difference_matrix(x, y, form="steinhaus")
    np.testing.assert_array_equal(emd_pairs(x, y, form="steinhaus"), np.diag(matrix))


def test_pairs_refuse_what_does_not_fit() -> None:
    rng = np.random.default_rng(12)
    batch = SignatureBatch.stack([random_signature(rng, 3) for _ in range(3)])
    shorter = SignatureBatch.stack([batch[0]])
    with pytest.raises(DataError, match="one length, got 3 and 1"):
        emd_pairs(batch, shorter)
    with pytest.raises(DataError, match="expected costs"):
        emd_pairs_from_costs(batch.weights, batch.weights, np.ones((3, 2, 2)))
    with pytest.raises(DataError, match="empty"):
        emd_pairs_from_costs([[0.0]], [[1.0]], [[[1.0]]], masses="balanced")


@pytest.mark.parametrize("masses", ["null", "rubner", "balanced"])
def test_below_skips_what_a_cheap_bound_rules_out_and_nothing_else(masses: str) -> None:
    rng = np.random.default_rng(13)
    centres = rng.normal(size=(12, 1, 6))
    points = 0.8 * centres + 0.1 * rng.normal(size=(12, 8, 6))
    groups = [
        Signature(rng.uniform(0.5, 1, 8), points[i % 12] + 0.02 * rng.normal(size=(8, 6))) for i in range(90)
    ]
    batch, other = SignatureBatch.stack(groups[:50]), SignatureBatch.stack(groups[50:])
    ground, shifts = GroundDistance(cap=1.5, position_dims=1), np.array([[-0.1], [0.0], [0.1]])
    for form in (None, "information"):
        if masses == "null" and form is None:
            continue
        for second in (None, other):
            arguments = {"masses": masses, "ground": ground, "form": form, "shifts": shifts}
            full = difference_matrix(batch, second, **arguments)
            cut = difference_matrix(batch, second, below=0.3, **arguments)
            np.testing.assert_array_equal(cut, np.where(full <= 0.3, full, np.inf))
            assert 0.02 < np.isfinite(cut).mean() < 0.5


def test_matrix_tasks_cover_each_wanted_column_once() -> None:
    rng = np.random.default_rng(14)
    for size in (0, 1, 7, 60):
        columns = np.sort(rng.choice(80, size, replace=False))
        tasks = row_tasks(3, columns, 4)
        covered = [j for _, first, last in tasks.tolist() for j in range(first, last)]
        assert covered == columns.tolist()
        assert (tasks[:, 0] == 3).all()
        assert ((tasks[:, 2] - tasks[:, 1]) <= 4).all()
