"""FAB-MAP's learning: sequential clustering and the Chow-Liu tree, against written-out references."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.baselines.fabmap.chow_liu import ChowLiuTree, learn_chow_liu_tree, mutual_information
from depthprint.baselines.fabmap.clustering import nearest_centres, sequential_clusters
from depthprint.baselines.fabmap.features import SiftFeatures, root_sift
from depthprint.baselines.fabmap.settings import FabMapSettings
from depthprint.errors import DataError, SettingsError


def slow_clusters(descriptors, size):
    """The algorithm word for word, one descriptor at a time."""
    centres = []
    for d in descriptors:
        if all(np.linalg.norm(d - c) > size for c in centres):
            centres.append(d)
    members = [[] for _ in centres]
    for d in descriptors:
        members[int(np.argmin([np.linalg.norm(d - c) for c in centres]))].append(d)
    return np.array([np.mean(m, axis=0) for m in members if m])


@pytest.mark.parametrize("size", [0.3, 0.8, 1.5])
def test_clusters_equal_those_found_one_descriptor_at_a_time(size):
    descriptors = np.random.default_rng(0).random((2500, 3)).astype(np.float32) * 3
    assert np.allclose(sequential_clusters(descriptors, size), slow_clusters(descriptors, size), atol=1e-5)


def test_distinct_points_are_their_own_words_and_one_large_cluster_is_their_mean():
    points = np.eye(4, dtype=np.float32)
    assert np.array_equal(sequential_clusters(points, 0.5), points)
    assert np.allclose(sequential_clusters(points, 10.0), points.mean(axis=0)[None])


def test_nearest_centre_breaks_ties_towards_the_first():
    centres = np.array([[0.0, 0], [2, 0], [0, 0]], dtype=np.float32)
    assert nearest_centres(np.array([[1.0, 0], [1.6, 0], [0, 0]], dtype=np.float32), centres).tolist() == [
        0,
        1,
        0,
    ]


def test_clustering_refuses_no_descriptors_and_no_size():
    with pytest.raises(DataError, match="n >= 1"):
        sequential_clusters(np.zeros((0, 128), dtype=np.float32), 0.5)
    with pytest.raises(SettingsError, match="cluster_size > 0"):
        sequential_clusters(np.zeros((3, 2), dtype=np.float32), 0.0)


def slow_information(a, b):
    """Sum over the four cells of two 0/1 columns: unsmoothed joint, smoothed marginals."""
    total = 0.0
    for x, y in itertools.product((0, 1), repeat=2):
        joint = np.mean((a == x) & (b == y))
        p_a, p_b = 0.98 * a.mean() + 0.01, 0.98 * b.mean() + 0.01
        if joint:
            total += joint * np.log(joint / ((p_a if x else 1 - p_a) * (p_b if y else 1 - p_b)))
    return total


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_information_and_tree_equal_the_written_out_sums(seed):
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(3, 30)), int(rng.integers(2, 7))
    seen = (rng.random((n, k)) < rng.random(k)).astype(int)
    images = [np.flatnonzero(row).astype(np.int32) for row in seen]
    tree = learn_chow_liu_tree(images, k, information_bound=0.0)
    for word in range(k):
        assert tree.p[word] == pytest.approx(0.98 * seen[:, word].mean() + 0.01)
        parent = int(tree.parent[word])
        if parent == word:
            continue
        for state, given_ in ((1, tree.p_given_parent), (0, tree.p_given_none)):
            times = (seen[:, parent] == state).sum()
            hits = ((seen[:, parent] == state) & (seen[:, word] == 1)).sum()
            assert given_[word] == pytest.approx(0.98 * hits / times + 0.01 if times else 0.01)
    information = np.array([[slow_information(seen[:, a], seen[:, b]) for b in range(k)] for a in range(k)])
    count = seen.sum(axis=0).astype(float)
    fast = np.array([mutual_information(count[a], count, seen[:, a] @ seen + 0.0, n) for a in range(k)])
    assert np.allclose(fast, information)
    learned = sum(information[w, tree.parent[w]] for w in range(k) if tree.parent[w] != w)
    assert learned == pytest.approx(most_information(information), abs=1e-9)


def most_information(information):
    """Heaviest spanning tree by trying every choice of edges."""
    k = len(information)
    edges = list(itertools.combinations(range(k), 2))
    best = -np.inf
    for chosen in itertools.combinations(edges, k - 1):
        group = list(range(k))
        for a, b in chosen:
            if group[a] == group[b]:
                break
            old, new = group[a], group[b]
            group = [new if g == old else g for g in group]
        else:
            # a negative edge is as good as none: the tree hangs such a word from its root
            best = max(best, sum(information[a, b] for a, b in chosen))
    return best


def test_a_chain_of_words_is_found_again():
    """z0 copies itself to z1, z1 mostly to z2: the tree must not link z0 and z2."""
    rng = np.random.default_rng(1)
    z0 = rng.random(4000) < 0.5
    z1 = np.where(rng.random(4000) < 0.95, z0, ~z0)
    z2 = np.where(rng.random(4000) < 0.9, z1, ~z1)
    images = [np.flatnonzero(row).astype(np.int32) for row in np.stack([z0, z1, z2], axis=1)]
    parent = learn_chow_liu_tree(images, 3).parent
    links = {frozenset((w, int(parent[w]))) for w in range(3) if parent[w] != w}
    assert links == {frozenset((0, 1)), frozenset((1, 2))}


def test_words_that_share_too_little_hang_from_the_root():
    rng = np.random.default_rng(2)
    seen = rng.random((5000, 5)) < np.array([0.8, 0.5, 0.5, 0.5, 0.5])
    images = [np.flatnonzero(row).astype(np.int32) for row in seen]
    assert learn_chow_liu_tree(images, 5, information_bound=0.1).parent.tolist() == [0, 0, 0, 0, 0]


def test_a_tree_refuses_impossible_probabilities_and_parents():
    half = np.array([0.5, 0.5])
    with pytest.raises(DataError, match=r"word 1 has the impossible p 1\.0"):
        ChowLiuTree(np.array([0, 0]), np.array([0.5, 1.0]), half, half)
    with pytest.raises(DataError, match="word 0 has the impossible parent 2"):
        ChowLiuTree(np.array([2, 0]), half, half, half)
    with pytest.raises(DataError, match="at least one training image"):
        learn_chow_liu_tree([], 3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"n_features": 0}, {"cluster_size": 0.0}, {"p_seen_if_there": 1.0}, {"p_seen_if_not": 0.5}, {"p_new": 1.0},
        {"motion_bias": 1.5}, {"keep": 0.0}, {"neighbours": -1}, {"new_place": "magic"}, {"information_bound": -1.0},
    ],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(wrong):
    with pytest.raises(SettingsError, match=next(iter(wrong))):
        FabMapSettings(**wrong)


def test_sift_features_are_unit_vectors_and_a_flat_picture_has_none():
    features = SiftFeatures(40)
    picture = (np.random.default_rng(3).random((120, 160)) * 255).astype(np.uint8)
    found = features(picture)
    assert 0 < len(found) <= 40
    assert np.allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-5)
    assert features(np.full((120, 160), 90, dtype=np.uint8)).shape == (0, 128)
    with pytest.raises(DataError, match="uint8"):
        features(picture.astype(np.float32))


def test_upright_features_are_one_for_each_place_and_size():
    picture = (np.random.default_rng(4).random((90, 90)) * 255).astype(np.uint8)
    upright, turned = (SiftFeatures(1000, upright=u) for u in (True, False))
    assert 0 < len(upright(picture)) < len(turned(picture))
    quarter = np.ascontiguousarray(np.rot90(picture))
    nearest = [(f(picture) @ f(quarter).T).max(axis=1).mean() for f in (upright, turned)]
    assert nearest[0] < nearest[1]


def test_root_sift_is_the_hellinger_map():
    rows = np.array([[4.0, 0, 12], [0, 0, 0]])
    assert np.allclose(root_sift(rows), [[0.5, 0, np.sqrt(0.75)], [0, 0, 0]])
