from __future__ import annotations

import itertools

import numpy as np
import pytest
from numba import njit

from depthprint._kernels.dual_bound import work_limit
from depthprint._kernels.pairs import solve_many
from depthprint._kernels.relaxation import normalise
from depthprint._kernels.transport import ABANDONED, OPTIMAL, make_scratch, solve_pair, solve_transport
from depthprint._pairs import check_status
from depthprint.errors import ConvergenceError


@njit(cache=False)
def _count_unsolved(p, q, costs, sizes):  # type: ignore[no-untyped-def]
    failed = 0
    ints, icost = make_scratch(8, 8)
    for x in range(len(p)):
        status = solve_transport(
            p[x], q[x], costs[x], sizes[x, 0], sizes[x, 1], 1.0, False, np.inf, ints, icost
        )[1]
        failed += status != OPTIMAL
    return failed


def count_unsolved_degenerate(count: int, seed: int) -> int:
    """Problems of small integers: most bases are degenerate, most costs tie."""
    rng = np.random.default_rng(seed)
    p, q = rng.integers(0, 3, (2, count, 8)).astype(float)
    costs = rng.integers(0, 3, (count, 8, 8)).astype(float)
    return int(_count_unsolved(p, q, costs, rng.integers(1, 9, (count, 2))))


def assignment(cost: np.ndarray) -> float:
    n = len(cost)
    return min(sum(cost[i, j] for i, j in enumerate(order)) for order in itertools.permutations(range(n)))


def test_degenerate_problems_do_not_cycle() -> None:
    assert count_unsolved_degenerate(50_000, 0) == 0


@pytest.mark.slow
def test_a_million_degenerate_problems_do_not_cycle() -> None:
    assert sum(count_unsolved_degenerate(50_000, seed) for seed in range(1, 21)) == 0


def test_equal_weights_solve_the_assignment_problem() -> None:
    rng = np.random.default_rng(0)
    for n in range(1, 7):
        for _ in range(10):
            cost = rng.integers(0, 5, (n, n)).astype(float)
            work, status, flow = solve_pair(np.ones(n), np.ones(n), cost, 0.0, True)
            assert status == OPTIMAL
            assert work == assignment(cost)
            assert set(np.unique(flow)) <= {0.0, 1.0}


@pytest.mark.parametrize(("m", "n"), [(1, 1), (1, 7), (7, 1), (20, 20), (20, 35), (35, 20), (121, 121)])
@pytest.mark.parametrize("ties", [False, True])
def test_equal_weights_agree_with_another_assignment_solver(m: int, n: int, ties: bool) -> None:
    from scipy.optimize import linear_sum_assignment

    rng = np.random.default_rng(m + 1000 * n)
    for unit in (1.0, 0.1, 1e-9):
        cost = rng.integers(0, 4, (m, n)).astype(float) if ties else rng.random((m, n))
        expected = unit * (cost[linear_sum_assignment(cost)].sum() + 0.75 * abs(m - n))
        work, status, flow = solve_pair(np.full(m, unit), np.full(n, unit), cost, 0.75, False)
        assert status == OPTIMAL
        assert work == pytest.approx(expected, rel=1e-12)
        assert np.count_nonzero(flow) == min(m, n)
        assert flow.sum(axis=0).max() == pytest.approx(unit, rel=1e-15)
        assert flow.sum(axis=1).max() == pytest.approx(unit, rel=1e-15)
        assert (flow * cost).sum() + 0.75 * unit * abs(m - n) == pytest.approx(work, rel=1e-12)


def test_equal_weights_give_the_value_of_nearly_equal_ones() -> None:
    rng = np.random.default_rng(8)
    for m, n in ((20, 20), (9, 14), (14, 9)):
        p, q, cost = np.ones(m), np.ones(n), rng.random((m, n))
        assigned = solve_pair(p, q, cost, 0.5, False)[0]
        p[0] += 1e-13  # no longer an assignment problem, so the simplex solves it
        assert solve_pair(p, q, cost, 0.5, False)[0] == pytest.approx(assigned, rel=1e-12, abs=1e-12)


def test_clusters_without_weight_do_not_matter() -> None:
    rng = np.random.default_rng(9)
    p, q = np.ones(12), np.ones(10)
    p[[0, 5]] = q[3] = 0
    cost = rng.random((12, 10))
    work, status, flow = solve_pair(p, q, cost, 1.0, False)
    kept = solve_pair(p[p > 0], q[q > 0], cost[p > 0][:, q > 0].copy(), 1.0, False)
    assert (work, status) == kept[:2]
    np.testing.assert_array_equal(flow[p > 0][:, q > 0], kept[2])
    assert flow.sum() == kept[2].sum() == 9


@pytest.mark.parametrize("unit", [True, False])
def test_the_value_does_not_depend_on_what_was_solved_before(unit: bool) -> None:
    rng = np.random.default_rng(10)
    count, k = 40, 15
    p, q = (np.ones((count, k)),) * 2 if unit else rng.random((2, count, k))
    costs = rng.random((count, k, k))
    forwards, status = solve_many(p, q, costs, 1.0, False)
    backwards, _ = solve_many(p[::-1].copy(), q[::-1].copy(), costs[::-1].copy(), 1.0, False)
    assert (status == OPTIMAL).all()
    np.testing.assert_array_equal(forwards, backwards[::-1])


@pytest.mark.parametrize("n", [1, 2, 30, 130, 200])
def test_all_costs_equal_or_zero(n: int) -> None:
    rng = np.random.default_rng(n)
    p, q = rng.random(n), rng.random(n)
    q *= p.sum() / q.sum()
    for value in (0.0, 0.75):
        work, status, _ = solve_pair(p, q, np.full((n, n), value), 0.0, True)
        assert status == OPTIMAL
        assert work == pytest.approx(value * p.sum(), rel=1e-14)


@pytest.mark.parametrize("scale", [1e-300, 1e-12, 1e12, 1e290])
def test_scale_of_weights_and_costs_does_not_matter(scale: float) -> None:
    rng = np.random.default_rng(1)
    p, q, cost = rng.random(12), rng.random(9), rng.random((12, 9))
    expected = solve_pair(p, q, cost, 0.5, False)[0]
    work, status, _ = solve_pair(p * scale, q * scale, cost, 0.5, False)
    assert status == OPTIMAL
    assert work / scale == pytest.approx(expected, rel=1e-13)
    work, status, _ = solve_pair(p, q, cost * scale, 0.5 * scale, False)
    assert status == OPTIMAL
    assert work / scale == pytest.approx(expected, rel=1e-13)


def test_weights_across_twelve_orders_of_magnitude() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        p, q = 10 ** rng.uniform(-12, 0, 25), 10 ** rng.uniform(-12, 0, 30)
        cost = rng.random((25, 30))
        _, status, flow = solve_pair(p, q, cost, 1.0, False)
        assert status == OPTIMAL
        assert (flow.sum(axis=1) <= p + 1e-15).all()
        assert (flow.sum(axis=0) <= q + 1e-15).all()
        assert flow.sum() == pytest.approx(min(p.sum(), q.sum()), rel=1e-14)


def test_one_cluster_against_many() -> None:
    rng = np.random.default_rng(3)
    q, cost = rng.random(50), rng.random((1, 50))
    assert solve_pair(np.array([q.sum()]), q, cost, 0.0, True)[0] == pytest.approx((q * cost[0]).sum())
    assert solve_pair(q, np.array([q.sum()]), cost.T.copy(), 0.0, True)[0] == pytest.approx(
        (q * cost[0]).sum()
    )


def test_identical_weights_on_a_zero_diagonal_cost_nothing() -> None:
    rng = np.random.default_rng(4)
    for n in (2, 21, 121):
        p, points = rng.random(n), rng.normal(size=(n, 3))
        cost = np.linalg.norm(points[:, None] - points[None], axis=2)
        work, status, flow = solve_pair(p, p.copy(), cost, 1.0, False)
        assert (work, status) == (0.0, OPTIMAL)
        np.testing.assert_allclose(flow, np.diag(p), rtol=0, atol=1e-14 * p.sum())


def test_unsolved_problems_raise() -> None:
    with pytest.raises(ConvergenceError, match="1 of 3"):
        check_status(np.array([0, 1, 0]))


@njit(cache=False)
def _solve_with_limit(p, q, cost, surplus_cost, limit):  # type: ignore[no-untyped-def]
    ints, icost = make_scratch(*cost.shape)
    return solve_transport(p, q, cost, len(p), len(q), surplus_cost, False, limit, ints, icost)[:2]


def test_a_limit_abandons_only_what_is_over_it() -> None:
    rng = np.random.default_rng(11)
    abandoned = 0
    for k in range(300):
        m, n = rng.integers(1, 25, 2)
        p, q, cost = rng.random(m), 10 ** rng.uniform(-9, 0, n), rng.random((m, n))
        if k % 3 == 0:
            p, q, cost = np.ceil(3 * p), np.ceil(3 * q), np.round(2 * cost)
        if k % 5 == 0:
            cost = np.full((m, n), 0.3)  # the first bound is the work itself
        work = solve_pair(p, q, cost, 0.5, False)[0]
        for share in (1.0, 1.0 + 1e-14, 1.01, 2.0):
            assert _solve_with_limit(p, q, cost, 0.5, work * share) == (work, OPTIMAL)
        for share in (0.0, 0.5, 0.9, 0.99):
            value, status = _solve_with_limit(p, q, cost, 0.5, work * share)
            assert (value, status) in {(work, OPTIMAL), (np.inf, ABANDONED)}
            abandoned += status == ABANDONED
    assert abandoned > 300


@pytest.mark.parametrize("surplus_cost", [0.0, 0.5])
def test_a_limit_abandons_assignments_only_over_it(surplus_cost: float) -> None:
    rng = np.random.default_rng(12)
    abandoned = 0
    for k in range(300):
        m, n = rng.integers(2, 25, 2) if k % 2 else np.full(2, rng.integers(2, 25))
        p, q, cost = np.full(m, 0.37), np.full(n, 0.37), rng.random((m, n)) ** 3
        if k % 5 == 0:
            cost = np.round(2 * cost)
        work = solve_pair(p, q, cost, surplus_cost, False)[0]
        for share in (1.0, 1.0 + 1e-14, 1.01, 2.0):
            assert _solve_with_limit(p, q, cost, surplus_cost, work * share) == (work, OPTIMAL)
        for share in (0.0, 0.5, 0.9, 0.99):
            value, status = _solve_with_limit(p, q, cost, surplus_cost, work * share)
            assert (value, status) in {(work, OPTIMAL), (np.inf, ABANDONED)}
            abandoned += status == ABANDONED
    assert abandoned > 150


@pytest.mark.parametrize("form", [0, 1, 2, 3])
def test_the_work_limit_of_a_distance_is_no_less_than_its_work(form: int) -> None:
    rng = np.random.default_rng(form)
    over = 0
    for _ in range(500):
        k_p, k_q = 10 ** rng.uniform(-6, 3, 2)
        work = rng.uniform(abs(k_p - k_q), k_p + k_q)
        distance = normalise(work, k_p, k_q, form)
        assert work_limit(distance, k_p, k_q, form) >= work
        over += work_limit(distance * 0.99, k_p, k_q, form) < work
    assert over > 100
    assert work_limit(0.5, 0.0, 0.0, form) == (0.5 * (1 + 1e-12) if form == 0 else np.inf)
