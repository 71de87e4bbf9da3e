"""The benchmarks' own arithmetic: turns, ratios, tables, and what a page keeps."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("benchmarks", reason="the benchmarks are part of a checkout, not of the package")

from benchmarks import emd_pairs, report, search
from benchmarks.families import FAMILIES, names_of
from benchmarks.harness import Comparison, interleaved_s
from benchmarks.peers import EMD_PEERS
from depthprint import Signature, SignatureBatch, difference_matrix

DEMANDED = {
    "emd20_pot_emd2", "emd20_pot_emd_c", "emd20_wasserstein", "emd20_cv2", "emd20_pyemd", "emd121_pot_emd_c",
    "nearest_brute_force", "omp_sklearn", "omp_spams", "learn_sklearn", "learn_spams", "matrix_pot", "scaling",
    "online", "recognise",
}  # fmt: skip


def row(**changes):
    values = {
        "name": "a",
        "ours_s": 2e-6,
        "peer_s": 1e-5,
        "peer": "p",
        "peer_version": "1",
        "threads": 1,
        "size": "s",
    }
    return Comparison(**{**values, **changes})


def some_signatures(n, k, seed):
    rng = np.random.default_rng(seed)
    return SignatureBatch.stack([Signature(rng.random(k), rng.random((k, 5))) for _ in range(n)])


def test_every_demanded_comparison_belongs_to_one_family():
    names = [name for family in FAMILIES for name in names_of(family)]
    assert len(set(names)) == len(names)
    assert set(names) >= DEMANDED


def test_contestants_take_turns_and_the_first_round_is_not_counted():
    turns = []
    taken = interleaved_s({"a": lambda: turns.append("a"), "b": lambda: turns.append("b")}, rounds=4)
    assert set(taken) == {"a", "b"}
    assert [sorted(turns[i : i + 2]) for i in range(0, 10, 2)] == [["a", "b"]] * 5
    assert turns[2:4] != turns[4:6]


def test_a_row_has_the_fields_and_the_ratio_is_the_peers_time_over_ours():
    given = row(extra={"points": [1]}).as_json()
    assert {"ours_s", "peer_s", "ratio", "peer", "peer_version", "threads", "size", "points"} <= set(given)
    assert given["ratio"] == pytest.approx(5.0)
    assert row(peer_s=None).as_json()["ratio"] is None


def test_results_keep_rows_of_an_earlier_run_of_the_same_kind_only(tmp_path):
    path = tmp_path / "results.json"
    report.write_results(path, {"a": row().as_json()}, quick=False)
    both = report.write_results(path, {"b": row(name="b").as_json()}, quick=False)
    assert {"a", "b"} <= set(both)
    assert json.loads(path.read_text()) == both
    assert "a" not in report.write_results(path, {"b": row().as_json()}, quick=True)


def test_the_table_goes_between_the_markers_and_the_text_about_it_stays(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{report.BEGIN}\nold\n{report.END}\nafter\n")
    absent = row(name="b", peer_s=None, note="no ready-made wheel").as_json()
    results = report.write_results(tmp_path / "r.json", {"a": row().as_json(), "b": absent}, quick=False)
    report.write_page(page, results)
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert "| a | s | 1 | 2 us a" in text
    assert "no ready-made wheel" in text
    page.write_text("no markers")
    with pytest.raises(ValueError, match="expected the lines"):
        report.write_page(page, results)


@pytest.mark.parametrize("name", EMD_PEERS)
def test_peers_solve_the_same_problems_as_ours(name):
    a, b = some_signatures(3, 6, 0), some_signatures(2, 4, 1)
    problems = emd_pairs.problems_of(a, b)
    exact = difference_matrix(a, b, masses="balanced", ground=emd_pairs.GROUND).ravel()
    np.testing.assert_allclose(emd_pairs.ours(problems)(), exact, rtol=1e-12)
    peer = EMD_PEERS[name]
    try:
        loop = peer.loop(problems)
    except ImportError as error:
        pytest.skip(f"{peer.package}: {error}")
    np.testing.assert_allclose(loop(), exact, rtol=10 * peer.tolerance)
    with pytest.raises(ArithmeticError, match="differs from ours"):
        emd_pairs._checked(peer, np.array(loop()) + 0.1, exact)


def test_heaviest_clusters_keep_their_order():
    signature = Signature(np.array([1.0, 5.0, 2.0, 4.0]), np.arange(4.0)[:, None])
    kept = emd_pairs.heaviest(signature, 2)
    assert kept.weights.tolist() == [5.0, 4.0]
    assert kept.points.ravel().tolist() == [1.0, 3.0]


def test_simulated_places_join_two_frames_and_leave_positions_where_they_are():
    batch = some_signatures(8, 5, 0)
    places = next(search._simulated_places(batch, 8, np.random.default_rng(0)))
    again = next(search._simulated_places(batch, 8, np.random.default_rng(0)))
    np.testing.assert_array_equal(places.points, again.points)
    positions = places.points[:100, :, -1].astype(np.float32)
    known = batch.points[:, :, -1].astype(np.float32)
    for place in positions:
        splits = [
            (place[:s] == known[:, :s]).all(axis=1).any() and (place[s:] == known[:, s:]).all(axis=1).any()
            for s in range(1, 5)
        ]
        assert any(splits)
    assert (places.points.astype(np.float32) == places.points).all()
