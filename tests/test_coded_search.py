"""Searches by 8-bit codes: bounds never over the distance, points never lost, the same sums on every processor."""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint._kernels.split_points import LINEAR, join_item, split_items
from depthprint._nearest_search import NearestSearch
from depthprint._pairs import side_arrays
from depthprint.signature import GroundDistance, Signature, SignatureBatch
from depthprint.signature_index import SignatureIndex, StreamDistance

COUNT = 70


def made_up_points(rng: np.random.Generator, kind: str, scale: float) -> np.ndarray:
    points = 0.3 * scale * rng.normal(size=(COUNT, 4, 5))
    if kind == "equal":
        points[:] = points[0, 0]
    elif kind == "outlier":
        points[3, 1] *= 1e4
        points[:5, 0, 2] *= 1e3
    elif kind == "on the grid":
        points = scale * rng.integers(-3, 4, points.shape).astype(float)
    elif kind == "one coordinate":
        points[..., 1:] *= 1e-7
    elif kind == "zero":
        points[::2] = 0.0
    elif kind == "many sizes":
        points *= 10.0 ** rng.uniform(-6, 2, (COUNT, 1, 1))
    return points


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(["even", "equal", "outlier", "on the grid", "one coordinate", "zero", "many sizes"]),
    scale=st.sampled_from([1e-25, 1e-6, 1.0, 1e7]),
    cap=st.sampled_from([0.1, 1.0, 50.0]),
    masses=st.sampled_from(["null", "rubner", "balanced"]),
    unit=st.booleans(),
)
def test_bounds_from_codes_are_under_the_distance_and_searches_equal_a_full_scan(
    seed: int, kind: str, scale: float, cap: float, masses: str, unit: bool
) -> None:
    rng = np.random.default_rng(seed)
    points = made_up_points(rng, kind, scale)
    weights = np.ones((COUNT, 4)) if unit else 10 ** rng.uniform(-3, 2, (COUNT, 4))
    counts = rng.integers(0, 5, COUNT)
    present = np.arange(4) < counts[:, None]
    batch = SignatureBatch(weights * present, points * present[..., None], counts)
    ground = GroundDistance(cap=cap * scale, null_cost=cap * scale, position_dims=1)
    stream = StreamDistance(ground, masses, "information")  # type: ignore[arg-type]
    query = Signature(np.ones(3), points[rng.integers(COUNT), :3] + 1e-3 * scale * rng.normal(size=(3, 5)))
    for shifts in (np.array([[0.2 * scale]]), np.array([[0.0], [0.1 * scale], [-0.3 * scale]])):
        index = SignatureIndex([stream], shifts)
        index.extend([batch])
        exact = index.distances((query,))
        side = side_arrays(SignatureBatch.stack([query]), masses, ground, right=False)
        search = NearestSearch([stream], index._shifts, index._stores, [side], len(index))
        search._prepare()
        groups, parts = search._coded_parts(np.arange(-(-COUNT // 32)))
        assert groups.tolist() == [0, 1, 2, 3, 4]
        assert (parts[0, :COUNT] <= exact * (1 + 1e-12)).all()
        assert (parts[0, COUNT:] == np.inf).all()
        order = np.argsort(exact, kind="stable")
        for k in (1, 5):
            found = index.query((query,), k=k)
            assert [match.id for match in found] == order[:k].tolist()
            assert [match.distance for match in found] == exact[order[:k]].tolist()


@pytest.mark.parametrize("period", [None, 0.5])
def test_circular_positions_and_several_streams_are_searched_exactly_among_many_places(
    monkeypatch: pytest.MonkeyPatch, period: float | None
) -> None:
    monkeypatch.setattr("depthprint._nearest_search._FEW_TO_SWEEP", 64)
    rng = np.random.default_rng(5)
    ground = GroundDistance(cap=1.5, position_dims=1, period=period)
    index = SignatureIndex(
        [StreamDistance(ground), StreamDistance(ground, weight=0.4)], np.array([[0.0], [0.2], [-0.1]])
    )
    centres = rng.normal(size=(2, 12, 6, 9))
    points = 0.3 * (np.repeat(centres, 40, axis=1) + 0.15 * rng.normal(size=(2, 480, 6, 9)))
    index.extend([SignatureBatch(np.ones((480, 6)), each, np.full(480, 6)) for each in points])
    monkeypatch.setattr("depthprint._nearest_search._BOUNDS_PER_ROW", 8)
    for number in (7, 211, 479):
        query = [Signature(np.ones(6), each[number] + 0.02 * rng.normal(size=(6, 9))) for each in points]
        exact = index.distances(query)
        order = np.argsort(exact, kind="stable")[:6]
        found = index.query(query, k=6)
        assert [match.id for match in found] == order.tolist()
        assert [match.distance for match in found] == exact[order].tolist()
        assert index.statistics.emds_solved < 480


def test_coded_bounds_are_near_the_relaxed_ones() -> None:
    rng = np.random.default_rng(8)
    stream = StreamDistance(GroundDistance(cap=4.0, null_cost=2.0))
    index = SignatureIndex([stream])
    points = 0.5 * rng.normal(size=(200, 8, 21))
    index.extend([SignatureBatch(np.ones((200, 8)), points, np.full(200, 8))])
    query = SignatureBatch(np.ones((1, 8)), points[:1] + 0.2, np.full(1, 8))
    side = side_arrays(query, "null", stream.ground, right=False)
    search = NearestSearch([stream], index._shifts, index._stores, [side], 200)
    search._prepare()
    _, parts = search._coded_parts(np.arange(7))
    assert (parts[0, :200] >= search.relaxed()[0] - 0.06).all()


def split(points: np.ndarray, counts: np.ndarray, rest: int = 3) -> tuple[bool, np.ndarray, np.ndarray]:
    n, d, k = points.shape
    codes = np.zeros((-(-n // 16), k, -(-d // 4), 16, 4), np.uint8)
    left = np.zeros((n, d, k, rest), np.uint8)
    scales, errors = np.zeros(n, np.float32), np.zeros(n, np.float32)
    exact = split_items(points, counts, 0, codes, left, scales, errors)
    joined = np.full(points.shape, np.nan)
    if rest:
        for item in range(n):
            join_item(codes, left, scales, item, int(counts[item]), joined[item])
    signed = codes.transpose(0, 3, 2, 4, 1).reshape(-1, codes.shape[2] * 4, k)[:n, :d].astype(float) - 128
    counted = np.where(np.abs(signed) <= LINEAR, signed, 0.0) * scales[:, None, None]
    present = np.arange(k) < counts[:, None, None]
    gaps = np.sqrt((np.where(present, points - counted, 0.0) ** 2).sum(axis=1)).max(axis=1)
    assert (gaps <= errors).all()
    return exact, joined, np.where(present, points, 0.0)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-20, 1e20), rest=st.sampled_from([0, 3]))
def test_points_of_single_precision_are_split_without_loss(seed: int, scale: float, rest: int) -> None:
    rng = np.random.default_rng(seed)
    points = scale * rng.normal(size=(20, 6, 3)) * 10.0 ** rng.uniform(-8, 0, (20, 6, 3))
    points[rng.random(points.shape) < 0.1] = 0.0
    points[0] = scale * np.ldexp(1.0, rng.integers(-20, 1, (6, 3)))
    exact, joined, kept = split(points.astype(np.float32).astype(float), rng.integers(0, 4, 20), rest)
    if rest:
        assert exact
        np.testing.assert_array_equal(joined, kept)


def test_points_that_cannot_be_split_say_so() -> None:
    counts = np.ones(1, np.int64)
    assert split(np.array([[[1.0], [0.5]]]), counts)[0]
    assert not split(np.array([[[1.0], [0.1]]]), counts)[0]  # of double precision
    assert not split(np.array([[[1.0], [2.0**-60]]]), counts)[0]


def test_an_item_that_cannot_be_split_loses_no_other() -> None:
    rng = np.random.default_rng(0)
    batch = SignatureBatch(
        np.ones((50, 3)), rng.normal(size=(50, 3, 4)).astype(np.float32).astype(float), np.full(50, 3)
    )
    tiny = batch[7].points.copy()
    tiny[0, 1] = 2.0**-80
    index = SignatureIndex([StreamDistance()])
    index.extend([batch])
    split_bytes = index.nbytes
    index.add([Signature(np.ones(3), tiny)])
    assert index.nbytes > split_bytes
    stored = index._stores[0].points
    assert stored.dtype == np.float32
    np.testing.assert_array_equal(stored[50 // 16, :, :, 50 % 16], tiny)
    for item in range(50):
        np.testing.assert_array_equal(stored[item // 16, :, :, item % 16], batch[item].points)


def test_one_weight_of_all_clusters_is_kept_once_until_another_comes() -> None:
    rng = np.random.default_rng(1)
    items = [Signature(np.full(k, 0.5), rng.normal(size=(k, 3))) for k in (2, 0, 3, 1)]
    index = SignatureIndex([StreamDistance()])
    for item in items:
        index.add([item])
    assert index._stores[0].weights.shape[1] == 0
    before = index.distances([items[2]])
    index.add([Signature(np.array([0.1, 0.7]), rng.normal(size=(2, 3)))])
    assert index._stores[0].weights.shape[1] == 3
    np.testing.assert_array_equal(index.distances([items[2]])[:4], before)
    assert index.query([items[0]])[0][:2] == (0, 0.0)


_SUMS = """
import sys
import numpy as np
from numba import njit
from depthprint._kernels.code_tiles import CODE_ROWS, load_codes, meet_codes
from depthprint._kernels.tiles import LANES

@njit
def run(p, starts, codes, mask, ratios, q, start, rows, columns):
    for j in range(codes.shape[1]):
        load_codes(codes, 0, j, mask, ratios, q, start)
        for tile in range(len(p)):
            meet_codes(p, starts, tile, q, start, rows, columns, j)

rng = np.random.default_rng(0)
tiles, quads, k = 2, 3, 5
signed = rng.integers(-107, 108, (k, quads, LANES, 4))
signed[0] = 107
mine = rng.integers(-127, 128, (tiles, quads, CODE_ROWS, 4))
mine[0, :, 0], mine[0, :, 1] = 127, -127
codes = (signed + 128).astype(np.uint8)[None].view(np.int32)[..., 0]
p = mine.astype(np.int8).view(np.int32)[..., 0]
starts = rng.integers(-99, 99, (tiles, CODE_ROWS, LANES)).astype(np.int32)
rows = np.full((tiles, CODE_ROWS, LANES), -(1 << 30), np.int32)
columns = np.full((k, LANES), -(1 << 30), np.int32)
q, start = np.zeros((quads, LANES), np.int32), np.zeros(LANES, np.int32)
mask = np.array([-1, -1, 255], np.int32)
run(p, starts, codes, mask, np.ones(LANES, np.float32), q, start, rows, columns)
counted = signed.copy()
counted[:, 2, :, 1:] = 0
norms = (counted ** 2).sum(axis=(1, 3))
sums = np.einsum("tqib,jqxb->tijx", mine, signed + 128) + starts[:, :, None] - norms
assert (rows == sums.max(axis=2)).all() and (columns == sums.max(axis=(0, 1))).all()
"""


@pytest.mark.parametrize("features", [None, "+avx2,+avxvnni", "+avx2", "+sse2"])
def test_sums_of_products_are_exact_with_and_without_vnni(features: str | None, tmp_path: Path) -> None:
    settings = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": features} if features else {}
    if features:
        from llvmlite import binding  # type: ignore[import-untyped]

        host = binding.get_host_cpu_features()
        if not all(host.get(each[1:], False) for each in features.split(",")):
            pytest.skip(f"this processor has not all of {features}")
    environment = {**os.environ, **settings, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", _SUMS], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_results_do_not_depend_on_the_weights_being_written_out() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(120, 4, 6))
    batch = SignatureBatch(np.ones((120, 4)), points, np.full(120, 4))
    for masses, form in product(("null", "balanced"), ("information", "joint")):
        stream = StreamDistance(GroundDistance(cap=3.0, null_cost=2.0), masses, form)  # type: ignore[arg-type]
        one, written = SignatureIndex([stream]), SignatureIndex([stream])
        one.extend([batch])
        written.extend([batch])
        written.add([Signature(np.array([0.3]), points[0, :1] + 50.0)])
        for number in (0, 60):
            assert one.query([batch[number]], k=7) == written.query([batch[number]], k=7, limit=120)
