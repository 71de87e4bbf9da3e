"""The cascade of bounds against a full scan: nothing that belongs among the nearest may be dismissed."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint._kernels.summaries import add_item_bounds
from depthprint._nearest_search import NearestSearch
from depthprint._pairs import side_arrays
from depthprint._signature_store import summary_slack, summary_vectors
from depthprint.errors import DataError
from depthprint.signature import GroundDistance, Signature, SignatureBatch
from depthprint.signature_index import SignatureIndex, StreamDistance

SHIFTS = np.array([[-0.3], [0.0], [0.4]])


def street_like(rng: np.random.Generator, count: int, float32: bool, unit: bool) -> list[Signature]:
    """A made-up drive: unit appearances that wander slowly, the last third a noisy copy of the first."""
    k, d = 7, 12
    walk = np.cumsum(0.25 * rng.normal(size=(count, k, d)), axis=0) + rng.normal(size=(k, d))
    third = count // 3
    walk[-third:] = walk[:third] + 0.1 * rng.normal(size=(third, k, d))
    signatures = []
    for points in walk:
        points = points / np.linalg.norm(points, axis=1, keepdims=True)
        points = np.column_stack([points, 0.25 * np.linspace(0, 1, k)])
        kept = rng.random(k) > 0.15
        kept[0] = True
        weights = np.ones(k) if unit else 10 ** rng.uniform(-2, 0, k)
        if float32:
            points, weights = points.astype(np.float32), weights.astype(np.float32)
        signatures.append(Signature(weights[kept], points[kept]))
    return signatures


def assert_exact(index: SignatureIndex, query: tuple[Signature, ...], limit: int | None) -> None:
    expected = index.distances(query, limit)
    best = np.argsort(expected, kind="stable")
    for k in (1, 4):
        found = index.query(query, k=k, limit=limit)
        np.testing.assert_allclose([m.distance for m in found], expected[best[:k]], rtol=1e-12, atol=1e-14)
        assert [m.id for m in found] == best[:k].tolist()


@pytest.mark.parametrize(
    ("masses", "form"),
    [*product(("null", "rubner", "balanced"), (None, "joint", "information", "steinhaus"))],
)
def test_search_equals_full_scan_with_window_and_adds(masses, form) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(0)
    ground = GroundDistance(cap=1.8, null_cost=1.1, position_dims=1)
    streams = [StreamDistance(ground, masses, form), StreamDistance(ground, masses, form, 0.5)]
    index = SignatureIndex(streams, SHIFTS)
    items = list(zip(street_like(rng, 210, True, True), street_like(rng, 210, False, False), strict=True))
    for number, item in enumerate(items):
        assert index.add(item) == number
        if number % 35 == 34:
            assert_exact(index, item, None)
            assert_exact(index, item, number - 20)
    assert_exact(index, items[0], None)


@pytest.mark.parametrize("period", [None, 0.5])
def test_search_solves_a_small_share_on_a_drive(period: float | None) -> None:
    rng = np.random.default_rng(1)
    index = SignatureIndex([StreamDistance(GroundDistance(position_dims=1, period=period))], SHIFTS)
    items = street_like(rng, 900, True, True)
    assert index.extend([SignatureBatch.stack(items)]) == range(900)
    for number in (620, 700, 800, 899):
        assert_exact(index, (items[number],), 600)
        index.query((items[number],), limit=600)
        assert index.statistics.emds_solved < 20
        assert index.statistics.bounds < 900  # of 600 items and 3 shifts


def summary_bounds(search: NearestSearch, items: np.ndarray) -> np.ndarray:
    """Bounds of some items' distances from their summary vectors, which `_block_bounds` draws boxes around."""
    (store,), (stream,), (side,) = search._stores, search._streams, search._sides
    others = store.gather(items)
    vectors, _ = summary_vectors(others.weights, others.points, stream.ground)
    out = np.zeros(len(items))
    add_item_bounds(
        search._vectors[0], side.masses[0], side.complexity[0], vectors, others.masses, others.complexity,
        np.arange(len(items)), summary_slack(stream.ground), stream.weight, search._rules[0], out,
    )  # fmt: skip
    return out


def test_every_bound_is_under_the_exact_distance() -> None:
    rng = np.random.default_rng(2)
    items = street_like(rng, 200, False, False)
    items[5] = Signature(np.zeros(0), np.zeros((0, 13)))
    for masses, form in product(("null", "rubner", "balanced"), ("joint", "information", "steinhaus")):
        ground = GroundDistance(cap=1.2, position_dims=1)
        stream = StreamDistance(ground, masses, form)
        index = SignatureIndex([stream], SHIFTS)
        index.extend([SignatureBatch.stack(items)])
        for query in (items[3], items[150], items[5]):
            exact = index.distances((query,))
            side = side_arrays(SignatureBatch.stack([query]), masses, ground, right=False)
            search = NearestSearch([stream], index._shifts, index._stores, [side], len(index))
            search._prepare()
            everything = np.arange(len(index))
            blocks = search._block_bounds()[everything // 32]
            summary = summary_bounds(search, everything)
            swept = search._swept_parts(everything)[0]
            assert (blocks <= summary + 1e-6).all()
            for bound in (blocks, summary, swept):
                assert (bound <= exact * (1 + 1e-12)).all()
            assert (swept > 0.3 * exact).mean() > 0.5


@pytest.mark.parametrize("unit", [True, False])
@pytest.mark.parametrize("dims", [2, 5, 33])
def test_swept_bounds_are_the_relaxed_ones_to_single_precision(unit: bool, dims: int) -> None:
    rng = np.random.default_rng(dims)

    def signature(clusters: int) -> Signature:
        weights = np.ones(clusters) if unit else rng.random(clusters)
        return Signature(weights, rng.normal(size=(clusters, dims)) * 10 ** rng.uniform(-3, -0.5))

    items = [signature(int(n)) for n in rng.integers(0, 18, 77)]
    ground = GroundDistance(cap=1.7, position_dims=1)
    for masses, form in product(("null", "rubner", "balanced"), ("information", "joint")):
        stream = StreamDistance(ground, masses, form)
        index = SignatureIndex([stream], np.array([[0.2]]))
        index.extend([SignatureBatch.stack(items[:50])])
        for item in items[50:]:
            index.add((item,))
        for clusters in (0, 1, 7, 16):
            side = side_arrays(SignatureBatch.stack([signature(clusters)]), masses, ground, right=False)
            search = NearestSearch([stream], index._shifts, index._stores, [side], len(index))
            search._prepare()
            chosen = np.flatnonzero(rng.random(len(items)) < 0.6)
            swept, relaxed = search._swept_parts(chosen)[0], search.relaxed(chosen)[0]
            assert (swept <= relaxed * (1 + 1e-12)).all()
            np.testing.assert_allclose(swept, relaxed, rtol=1e-3, atol=2e-2)


def test_points_that_are_positions_alone_are_searched_exactly() -> None:
    rng = np.random.default_rng(6)
    index = SignatureIndex([StreamDistance(GroundDistance(position_dims=2))])
    index.extend([SignatureBatch(rng.random((150, 3)), rng.random((150, 3, 2)), np.full(150, 3))])
    assert_exact(index, (Signature(rng.random(3), rng.random((3, 2))),), None)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([1e-30, 1e-6, 1.0, 1e6, 1e30]))
def test_scale_does_not_make_a_bound_dismiss_too_much(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    ground = GroundDistance(cap=scale, null_cost=scale)
    index = SignatureIndex([StreamDistance(ground, "null", "information")])
    points = scale * 0.3 * rng.normal(size=(150, 4, 5))
    weights = rng.random((150, 4)) * 10 ** rng.uniform(-6, 6)
    counts = np.full(150, 4)
    index.extend([SignatureBatch(weights, points, counts)])
    assert_exact(index, (Signature(weights[7], points[7] + 0.05 * scale * rng.normal(size=(4, 5))),), None)


def test_items_that_float32_holds_take_half_the_memory_and_lose_nothing() -> None:
    rng = np.random.default_rng(3)
    coarse, fine = street_like(rng, 64, True, True), street_like(rng, 64, False, True)
    index = SignatureIndex([StreamDistance()])
    index.extend([SignatureBatch.stack(coarse)])
    small = index.nbytes
    stored = index._stores[0].points
    assert stored.dtype == np.float32
    np.testing.assert_array_equal(stored[0, : len(coarse[9]), :, 9], coarse[9].points)
    index.add((fine[0],))
    assert index.nbytes > 1.8 * small
    for number, item in enumerate([*coarse, fine[0]]):
        assert index.query((item,)) == [(number, 0.0, 0)]


def test_extending_equals_adding_one_by_one() -> None:
    rng = np.random.default_rng(4)
    items = street_like(rng, 150, True, False)
    one, many = SignatureIndex([StreamDistance()]), SignatureIndex([StreamDistance()])
    for item in items:
        one.add((item,))
    many.extend([SignatureBatch.stack(items[:70])])
    many.extend([SignatureBatch.stack(items[70:])])
    for item in items[::29]:
        assert one.query((item,), k=5) == many.query((item,), k=5)
    np.testing.assert_array_equal(one.distances((items[0],)), many.distances((items[0],)))
    streams = SignatureIndex([StreamDistance(), StreamDistance()])
    with pytest.raises(DataError, match="one length"):
        streams.extend([SignatureBatch.stack(items[:2]), SignatureBatch.stack(items[:3])])
    assert len(streams) == 0
