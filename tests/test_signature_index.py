from __future__ import annotations

import numpy as np
import pytest

from depthprint.emd import emd
from depthprint.errors import DataError, FingerprintError, SettingsError
from depthprint.ncd import FORMS
from depthprint.signature import GroundDistance, Signature
from depthprint.signature_index import SignatureIndex, StreamDistance

DIMS = (5, 3)


def item(rng: np.random.Generator, near: tuple[Signature, ...] | None = None) -> tuple[Signature, ...]:
    """A signature a stream; with ``near`` a noisy copy of it."""
    if near is not None:
        return tuple(
            Signature(
                s.weights * rng.uniform(0.9, 1.1, len(s)), s.points + 0.05 * rng.normal(size=s.points.shape)
            )
            for s in near
        )
    sizes = rng.integers(1, 9, len(DIMS))
    return tuple(
        Signature(rng.random(k), 0.5 * rng.normal(size=(k, d))) for k, d in zip(sizes, DIMS, strict=True)
    )


def stream_value(stream: StreamDistance, x: Signature, y: Signature, shift: np.ndarray) -> float:
    """Slow reference of one stream's distance."""
    if stream.masses == "null":
        k_x, k_y = x.mass * stream.ground.null_cost, y.mass * stream.ground.null_cost
    else:
        k_x, k_y = (stream.ground.null_cost * (s.mass > 0) for s in (x, y))
    if x.mass == 0 or y.mass == 0:
        e = k_x + k_y
    else:
        e = emd(x, y, masses=stream.masses, ground=stream.ground, shift=shift).value
    return stream.weight * (e if stream.form is None else float(FORMS[stream.form](e, k_x, k_y)))


def brute_force(streams, shifts, stored, query) -> tuple[np.ndarray, np.ndarray]:
    table = np.array(
        [
            [
                sum(
                    stream_value(stream, x, y, tables[s])
                    for stream, tables, x, y in zip(streams, shifts, query, other, strict=True)
                )
                for s in range(len(shifts[0]))
            ]
            for other in stored
        ]
    )
    return table.min(axis=1), table.argmin(axis=1)


STREAMS = {
    "one shift": (
        [StreamDistance(GroundDistance(), "null", "joint"), StreamDistance(weight=0.5)],
        [np.zeros((1, 0))] * 2,
    ),
    "shifts and period": (
        [
            StreamDistance(GroundDistance(position_dims=1, period=3.0), "null", "information"),
            StreamDistance(GroundDistance(cap=1.5, position_dims=2), "null", "steinhaus", 0.7),
        ],
        [np.array([[-0.5], [0.0], [0.5]]), np.array([[-0.25, 0.0], [0.0, 0.0], [0.25, 0.0]])],
    ),
    "other masses": (
        [
            StreamDistance(GroundDistance(position_dims=1), "balanced", "steinhaus"),
            StreamDistance(GroundDistance(position_dims=1), "rubner", "joint", 2.0),
        ],
        [np.array([[-0.3], [0.0]])] * 2,
    ),
    "plain EMD": (
        [StreamDistance(form=None), StreamDistance(GroundDistance(null_cost=2.0), "null", None)],
        [np.zeros((1, 0))] * 2,
    ),
}


@pytest.mark.parametrize("case", STREAMS)
def test_query_equals_brute_force_while_adding_and_with_a_limit(case: str) -> None:
    streams, shifts = STREAMS[case]
    rng = np.random.default_rng(0)
    index = SignatureIndex(streams, shifts)
    stored: list[tuple[Signature, ...]] = []
    for n in range(45):
        new = item(rng, stored[int(rng.integers(n))] if n % 3 == 2 else None)
        assert index.add(new) == n
        stored.append(new)
        if n % 11:
            continue
        query = item(rng, stored[int(rng.integers(n + 1))])
        expected, expected_shift = brute_force(streams, shifts, stored, query)
        np.testing.assert_allclose(index.distances(query), expected, rtol=1e-12, atol=1e-14)
        for limit in (None, n // 2):
            among = expected[:limit]
            for k in (1, 3, 100):
                found = index.query(query, k=k, limit=limit)
                best = np.argsort(among, kind="stable")[:k]
                assert [m.id for m in found] == best.tolist()
                np.testing.assert_allclose([m.distance for m in found], among[best], rtol=1e-12, atol=1e-14)
                assert [m.shift_index for m in found] == expected_shift[best].tolist()


def test_search_solves_few_of_the_emds() -> None:
    rng = np.random.default_rng(1)
    index = SignatureIndex([StreamDistance(), StreamDistance()])
    stored = [item(rng) for _ in range(400)]
    for each in stored:
        index.add(each)
    for i in (3, 200, 399):
        assert index.query(item(rng, stored[i]))[0].id == i
        assert index.statistics.candidates == 400
        assert 0 < index.statistics.bounds <= 800
        assert index.statistics.emds_solved <= 40


def test_equal_items_come_by_number_and_all_of_them_are_found() -> None:
    rng = np.random.default_rng(2)
    index = SignatureIndex([StreamDistance(), StreamDistance()])
    same = item(rng)
    for n in range(300):
        index.add(same if n % 2 else item(rng))
    found = index.query(same, k=150)
    assert [m.id for m in found] == list(range(1, 300, 2))
    assert all(m.distance == 0 for m in found)


def test_relaxed_distance_is_a_lower_bound_and_solves_nothing() -> None:
    rng = np.random.default_rng(3)
    streams, shifts = STREAMS["shifts and period"]
    index = SignatureIndex(streams, shifts)
    for _ in range(60):
        index.add(item(rng))
    query = item(rng)
    relaxed = index.distances(query, relaxed=True)
    assert index.statistics.emds_solved == 0
    exact = index.distances(query)
    assert (relaxed <= exact * (1 + 1e-12)).all()
    assert (relaxed > 0.5 * exact).all()
    found = index.query(query, k=5, relaxed=True)
    np.testing.assert_array_equal([m.id for m in found], np.argsort(relaxed, kind="stable")[:5])


def test_empty_signatures_are_at_distance_one_from_others() -> None:
    rng = np.random.default_rng(4)
    for masses in ("null", "balanced"):
        stream = StreamDistance(masses=masses, form="steinhaus")
        index = SignatureIndex([stream])
        empty = Signature(np.zeros(0), np.zeros((0, 5)))
        index.add((empty,))
        full = item(rng)[:1]
        index.add(full)
        np.testing.assert_array_equal(index.distances((empty,)), [0, 1])
        np.testing.assert_array_equal(index.distances(full), [1, 0])
    plain = SignatureIndex([StreamDistance(masses="balanced", form=None)])
    with pytest.raises(DataError, match="empty"):
        plain.add((empty,))
    assert len(plain) == 0


def test_result_does_not_depend_on_the_number_of_threads() -> None:
    import numba

    rng = np.random.default_rng(5)
    streams, shifts = STREAMS["shifts and period"]
    index = SignatureIndex(streams, shifts)
    for _ in range(100):
        index.add(item(rng))
    query = item(rng)
    threads = numba.get_num_threads()
    results = []
    try:
        for count in (threads, 1):
            numba.set_num_threads(count)
            results.append((index.query(query, k=7), index.distances(query).tolist()))
    finally:
        numba.set_num_threads(threads)
    assert results[0] == results[1]


def test_empty_index_finds_nothing() -> None:
    index = SignatureIndex([StreamDistance(), StreamDistance()])
    query = item(np.random.default_rng(6))
    assert index.query(query, k=3) == []
    assert len(index.distances(query)) == 0
    index.add(query)
    assert index.query(query, limit=0) == []


def test_refused_items_leave_the_index_as_it_was() -> None:
    rng = np.random.default_rng(7)
    index = SignatureIndex([StreamDistance(), StreamDistance()])
    first = item(rng)
    index.add(first)
    other = Signature(first[1].weights, first[1].points, "another model")
    with pytest.raises(FingerprintError):
        index.add((first[0], other))
    with pytest.raises(DataError, match="dimension"):
        index.query((first[0], first[0]))
    with pytest.raises(DataError, match="expected 2 signatures"):
        index.add(first[:1])
    assert len(index) == 1


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(SettingsError, match="at least one stream"):
        SignatureIndex([])
    with pytest.raises(SettingsError, match="weight"):
        StreamDistance(weight=0.0)
    with pytest.raises(SettingsError, match="one shift table for each"):
        SignatureIndex([StreamDistance()], [])
    with pytest.raises(SettingsError, match="position offsets"):
        SignatureIndex([StreamDistance()], np.zeros((3, 1)))
    with pytest.raises(SettingsError, match="differ in length"):
        SignatureIndex([StreamDistance(), StreamDistance()], [np.zeros((3, 0)), np.zeros((2, 0))])
    with pytest.raises(SettingsError, match="k >= 1"):
        SignatureIndex([StreamDistance()]).query((Signature([1.0], [[0.0]]),), k=0)


def test_distances_to_few_items_are_those_of_a_scan_of_all(monkeypatch):
    from depthprint import _full_scan

    rng = np.random.default_rng(7)
    ground = GroundDistance(position_dims=1, cap=1.2)
    shifts = np.array([[0.0], [0.1], [-0.1]])
    index = SignatureIndex([StreamDistance(ground), StreamDistance(ground, weight=0.5)], shifts)
    for _ in range(12):
        index.add([Signature(np.ones(5), rng.normal(0, 0.5, (5, 4)), "model") for _ in range(2)])
    query = [Signature(np.ones(6), rng.normal(0, 0.5, (6, 4)), "model") for _ in range(2)]
    few = index.distances_of(query, np.array([11, 3, 4]))
    monkeypatch.setattr(_full_scan, "_FEW_ITEMS", 0)
    np.testing.assert_allclose(few, index.distances_of(query, np.array([11, 3, 4])), rtol=1e-12)
    np.testing.assert_allclose(index.distances(query)[[11, 3, 4]], few, rtol=1e-12)
