"""FAB-MAP's probabilities, index, posterior, recogniser and model file."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from depthprint.baselines.fabmap.belief import FabMap
from depthprint.baselines.fabmap.chow_liu import ChowLiuTree, learn_chow_liu_tree
from depthprint.baselines.fabmap.depth_picture import DepthPicture
from depthprint.baselines.fabmap.inverted_index import LikelihoodIndex
from depthprint.baselines.fabmap.likelihood import full_log_likelihoods
from depthprint.baselines.fabmap.model import FabMapModel, train_fabmap
from depthprint.baselines.fabmap.model_file import load_fabmap, save_fabmap
from depthprint.baselines.fabmap.posterior import (
    log_odds_against,
    log_posterior,
    motion_prior,
    smoothed,
    with_neighbours,
)
from depthprint.baselines.fabmap.recognizer import FabMapRecognizer
from depthprint.baselines.fabmap.settings import FabMapSettings
from depthprint.errors import DataError, ModelError, SettingsError
from depthprint.place_methods import make_place_recognizer
from synthetic import boxes, scan

NO_WRONG = FabMapSettings(new_place="mean-field")
VARIANTS = [
    NO_WRONG,
    FabMapSettings(p_seen_if_not=0.05),
    FabMapSettings(tree=False, p_seen_if_not=0.01),
]


def random_words(rng, k, share=0.3):
    return np.flatnonzero(rng.random(k) < share).astype(np.int32)


def random_tree(rng, k):
    parent = np.array([0] + [int(rng.integers(0, w)) for w in range(1, k)])
    p, p1, p0 = rng.uniform(0.02, 0.9, (3, k))
    p1[0] = p0[0] = p[0]
    return ChowLiuTree(parent, p, p1, p0)


def slow_log_likelihood(words, place, tree, s):
    """The specification's sums, one word and one hidden variable at a time."""
    total = 0.0
    for q in range(len(tree)):
        z, held = q in words, q in place
        parent = int(tree.parent[q])
        zp = parent != q and parent in words
        detect = {True: s.p_seen_if_there, False: s.p_seen_if_not}
        p_z = tree.p[q]

        def of_detector(value, there, detect=detect):
            return detect[there] if value else 1 - detect[there]

        alpha = of_detector(held, True) * p_z
        beta = of_detector(held, False) * (1 - p_z)
        p_there = alpha / (alpha + beta)
        given = tree.p_given_parent[q] if zp else tree.p_given_none[q]
        p_q = 0.0
        for there, weight in ((True, p_there), (False, 1 - p_there)):
            prior_z = p_z if z else 1 - p_z
            given_z = given if z else 1 - given
            a = prior_z * of_detector(not z, there) * (1 - given_z)
            b = (1 - prior_z) * of_detector(z, there) * given_z
            p_q += weight * (b / (a + b) if s.tree else of_detector(z, there))
        total += np.log(p_q)
    return total


@pytest.mark.parametrize("settings", VARIANTS, ids=["tree", "false alarms", "naive Bayes"])
def test_full_likelihood_equals_the_written_out_sums(settings):
    rng = np.random.default_rng(0)
    tree = random_tree(rng, 12)
    places = [random_words(rng, 12) for _ in range(4)]
    for _ in range(6):
        words = random_words(rng, 12)
        expected = [slow_log_likelihood(set(words), set(p), tree, settings) for p in places]
        assert np.allclose(full_log_likelihoods(words, places, tree, settings), expected)


@pytest.mark.parametrize("settings", VARIANTS, ids=["tree", "false alarms", "naive Bayes"])
def test_inverted_index_equals_the_full_likelihood(settings):
    rng = np.random.default_rng(1)
    tree = random_tree(rng, 200)
    places = [random_words(rng, 200, share) for share in (0.0, 0.05, 0.2, 0.5, 1.0)]
    index = LikelihoodIndex(tree, settings)
    assert [index.add(p) for p in places] == list(range(5))
    for share in (0.0, 0.1, 0.4, 1.0):
        words = random_words(rng, 200, share)
        full = full_log_likelihoods(words, places, tree, settings)
        assert np.allclose(index.log_likelihoods(words), full)
        assert np.allclose(index.log_likelihoods(words, 3), full[:3])
        assert index.log_likelihoods(words, 0).shape == (0,)


def test_probabilities_of_all_images_add_up_to_one_under_naive_bayes():
    settings = FabMapSettings(tree=False, p_seen_if_not=0.02)
    tree = random_tree(np.random.default_rng(2), 5)
    place = np.array([1, 3], dtype=np.int32)
    images = [np.flatnonzero(bits).astype(np.int32) for bits in itertools.product((0, 1), repeat=5)]
    total = sum(np.exp(full_log_likelihoods(words, [place], tree, settings)[0]) for words in images)
    assert total == pytest.approx(1.0)


def small_model(settings=None):
    rng = np.random.default_rng(3)
    training = tuple(random_words(rng, 30) for _ in range(20))
    tree = learn_chow_liu_tree(training, 30)
    return FabMapModel(settings or FabMapSettings(), rng.random((30, 128), np.float32), tree, training)


def test_sampled_new_place_is_the_mean_likelihood_over_training_images():
    model = small_model()
    words = random_words(np.random.default_rng(4), 30)
    each = full_log_likelihoods(words, model.training, model.tree, model.settings)
    expected = np.log(np.mean(np.exp(each)))
    assert FabMap(model).new_place_log_likelihood(words) == pytest.approx(expected)


def test_mean_field_new_place_has_each_word_at_its_prior():
    model = small_model(NO_WRONG)
    words = random_words(np.random.default_rng(5), 30)
    total = 0.0
    for q in range(30):
        z, parent, p = q in words, int(model.tree.parent[q]), model.tree.p[q]
        given = (model.tree.p_given_parent if parent != q and parent in words else model.tree.p_given_none)[q]
        there = (1 - p) * 0.39 * given / (p * 0.61 * (1 - given) + (1 - p) * 0.39 * given)
        total += np.log(p * there if z else 1 - p * there)
    assert FabMap(model).new_place_log_likelihood(words) == pytest.approx(total)


def test_motion_prior_is_the_weighted_neighbourhood_of_the_earlier_belief():
    settings = FabMapSettings(motion_bias=0.25, p_new=0.8)
    earlier = np.array([0.4, 0.1, 0.3, 0.2])
    prior = motion_prior(earlier, 3, settings)
    expected = [1.5 * 0.1 + 0.1 + 0.5 * 0.3, 1.5 * 0.1 + 0.3 + 0.5 * 0.2, 1.5 * 0.3 + 0.2 + 0.5 * 0.2]
    assert np.allclose(prior, [0.8, *(np.array(expected) / 3)])
    assert np.allclose(motion_prior(None, 4, settings), [0.8, 0.25, 0.25, 0.25, 0.25])
    assert motion_prior(earlier, 0, settings).tolist() == [0.8]
    assert len(motion_prior(earlier, 5, settings)) == 6


def test_posterior_adds_up_to_one_also_where_likelihoods_underflow():
    log_p = log_posterior(np.array([-9000.0, -9001.0, -9500.0]), np.array([0.5, 0.4, 0.1]))
    assert np.exp(log_p).sum() == pytest.approx(1.0)
    assert np.exp(log_p[0] - log_p[1]) == pytest.approx(np.e * 0.5 / 0.4)
    settings = FabMapSettings(keep=0.9)
    assert np.allclose(
        smoothed(np.log([0.5, 0.25, 0.25]), settings), np.array([0.45, 0.225, 0.225]) + 0.1 / 3
    )


def test_neighbours_join_their_probabilities():
    p = np.array([0.1, 0.2, 0.3, 0.15])
    assert np.allclose(np.exp(with_neighbours(np.log(p), 1)), [0.3, 0.6, 0.65, 0.45])
    assert np.array_equal(with_neighbours(np.log(p), 0), np.log(p))


def test_a_belief_adds_up_to_one_and_a_seen_image_is_no_new_place():
    model = small_model()
    rng = np.random.default_rng(6)
    drive = FabMap(model)
    images = [random_words(rng, 30) for _ in range(8)]
    for words in images:
        belief = drive.locate(words)
        assert np.exp(belief.log_new) + np.exp(belief.log_places).sum() == pytest.approx(1.0)
        drive.follow(belief)
        drive.add(words)
    again = drive.locate(images[5])
    assert int(again.log_places.argmax()) == 5


def test_the_belief_moves_along_with_a_drive_and_only_then():
    model = small_model()
    rng = np.random.default_rng(7)
    images = [random_words(rng, 30) for _ in range(6)]
    recognizer = FabMapRecognizer(model)
    for words in images:
        recognizer.add(words)
    first = recognizer.query(images[2], k=6)
    assert recognizer.query(images[2], k=6) == first
    recognizer.add(images[2])
    moved = {m.place: m.distance for m in recognizer.query(images[3], k=6, limit=6)}
    still = FabMapRecognizer(model)
    for words in images:
        still.add(words)
    unmoved = {m.place: m.distance for m in still.query(images[3], k=6, limit=6)}
    assert moved[3] < unmoved[3]


@pytest.mark.parametrize("neighbours", [0, 1])
def test_the_distance_is_the_log_odds_also_where_the_probability_rounds_to_one(neighbours):
    p = np.array([0.2, 0.55, 0.05, 0.1])
    joined = np.exp(with_neighbours(np.log(p), neighbours))
    assert np.allclose(
        log_odds_against(float(np.log(0.1)), np.log(p), neighbours), np.log((1 - joined) / joined)
    )
    sure = [log_odds_against(-log, np.array([0.0]), neighbours)[0] for log in (50.0, 400.0, 900.0)]
    assert sure == [-50.0, -400.0, -900.0]


def learned(n=12):
    picture = DepthPicture(2.0, 20.0, width=160)
    settings = FabMapSettings(n_features=60, cluster_size=0.6)
    return train_fabmap([picture(boxes(i)) for i in range(n)], settings), picture


def test_a_model_file_gives_the_same_words_and_beliefs(tmp_path):
    model, picture = learned()
    path = save_fabmap(model, picture, tmp_path / "fabmap.npz")
    loaded, drawn = load_fabmap(path)
    assert drawn == picture
    assert loaded.settings == model.settings
    assert np.array_equal(loaded.tree.parent, model.tree.parent)
    assert [w.tolist() for w in loaded.training] == [w.tolist() for w in model.training]
    words = [m.words(picture(boxes(40))) for m in (model, loaded)]
    assert np.mean(np.isin(*words)) > 0.9  # centres are kept in 8 bits


def test_damaged_model_files_are_refused(tmp_path):
    path = save_fabmap(*learned(3), tmp_path / "fabmap.npz")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ModelError, match=r"fabmap\.npz"):
        load_fabmap(path)
    with pytest.raises(ModelError, match="absent"):
        load_fabmap(tmp_path / "absent.npz")


def test_models_whose_parts_do_not_fit_are_refused():
    model = small_model()
    with pytest.raises(DataError, match="vocabulary of 30 words"):
        FabMapModel(model.settings, model.centres[:29], model.tree, model.training)
    with pytest.raises(DataError, match="sorted, distinct"):
        FabMapModel(model.settings, model.centres, model.tree, (np.array([3, 3], dtype=np.int32),))
    with pytest.raises(DataError, match="training image"):
        FabMapModel(model.settings, model.centres, model.tree, ())


def test_training_on_featureless_pictures_is_refused():
    with pytest.raises(DataError, match="single SIFT feature"):
        train_fabmap([np.full((64, 64), 7, dtype=np.uint8)] * 2)


def test_fitting_replaces_the_vocabulary_and_forgets_the_places():
    recognizer = FabMapRecognizer(*learned(4))
    recognizer.add(recognizer.describe(boxes(0)))
    recognizer.fit([boxes(i) for i in range(20, 26)])
    assert recognizer.query(recognizer.describe(boxes(0))) == []
    with pytest.raises(ModelError, match="got none"):
        recognizer.fit([])


def test_the_registry_takes_the_shipped_vocabulary_or_learns_one():
    shipped = make_place_recognizer("fabmap2", "street")
    learned_here = make_place_recognizer("fabmap2", "street", learn_from=[boxes(i) for i in range(8)])
    words = [method.describe(boxes(3)) for method in (shipped, learned_here)]
    assert all(len(w) for w in words)
    assert words[0].tolist() != words[1].tolist()
    with pytest.raises(ModelError, match="no FAB-MAP model ships for preset 'object'"):
        make_place_recognizer("fabmap2", "object")


def test_pictures_are_brighter_where_nearer_and_planar_scans_are_drawn_from_above():
    picture = DepthPicture(1.0, 20.0, width=96, least_height=48, smoothing=0.0)
    image = boxes(1)
    drawn = picture(image)
    assert drawn.dtype == np.uint8
    assert drawn.shape == (72, 96)
    near = np.nanargmin(image.ranges_m[:, 64])
    assert drawn[near * 72 // 96, 48] >= drawn[:, 48].max() - 2
    plan = picture(scan(0))
    assert plan.shape == (96, 96)
    assert plan[:48].any()
    assert not plan[49:].any()  # nothing is seen behind a scanner of 180 degrees
    with pytest.raises(SettingsError, match="near_m < far_m"):
        DepthPicture(5.0, 2.0)
