"""The cascade: fused proposals, any method with a geometric check, the stages that can be turned off."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from depthprint.baselines.cosine import CosineRecognizer
from depthprint.cascade import assembly
from depthprint.cascade.assembly import make_cascade
from depthprint.cascade.fused_recognizer import FusedRecognizer
from depthprint.cascade.proposals import spread_in_time, taken_in_turn
from depthprint.cascade.range_thumbnail import RangeThumbnails, range_thumbnail
from depthprint.cascade.settings import CascadeSettings
from depthprint.cascade.verified_recognizer import VerifiedDescription, VerifiedRecognizer
from depthprint.complexity_recognizer import ComplexityRecognizer
from depthprint.encoder import Encoder
from depthprint.errors import DataError, SettingsError
from depthprint.loop_closure import LoopClosureDetector
from depthprint.loop_status import LoopStatus
from depthprint.place_methods import PLACE_METHODS, make_place_recognizer
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceMatch
from depthprint.simulation import training
from depthprint.verification.depth_view import make_depth_view
from depthprint.verification.verifier import GeometricVerifier
from depthprint.verification.view_cache import ViewCache
from synthetic import boxes
from test_encoder import DEFAULT, small
from test_verification import ROW, SPINNING, STEREO, block_world, pose_at

PLACES = 9


@pytest.fixture(scope="module")
def encoder() -> Encoder:
    return Encoder(small("street")).fit(DEFAULT)


def row_at(seed: int, x: float, y: float = 0.0, yaw: float = 0.2) -> RangeImage:
    ranges = block_world(seed).cast(ROW, pose_at(ROW, x, y, yaw, 0.5))
    return RangeImage(ranges, ROW, sensor_height_m=0.5, source=f"block world {seed}")


class Listed:
    """Proposes places in the order of a list; every distance is known beforehand."""

    def __init__(self, distances: list[float]):
        self.distances = distances
        self.stored = 0
        self.asked: list[int] = []

    def fit(self, images):
        self.stored = 0
        return self

    def describe(self, image):
        return image.source

    def add(self, description):
        self.stored += 1
        return self.stored - 1

    def query(self, description, k=1, limit=None):
        self.asked.append(k)
        n = self.stored if limit is None else min(limit, self.stored)
        order = sorted(range(n), key=lambda j: (self.distances[j], j))[:k]
        return [PlaceMatch(j, self.distances[j]) for j in order]

    def distance(self, first, second):
        return 0.5


def test_query_of_few_places_leaves_the_number_of_threads_as_it_was(encoder):
    import numba

    from depthprint._kernels.threads import one_thread

    before = numba.get_num_threads()
    with one_thread():
        assert numba.get_num_threads() == 1
    with pytest.raises(DataError), one_thread():
        raise DataError("inside")
    fused = FusedRecognizer(encoder)
    for image in DEFAULT[:3]:
        fused.add(fused.describe(image))
    assert fused.query(fused.describe(DEFAULT[0]))[0].place == 0
    assert numba.get_num_threads() == before


@pytest.mark.parametrize("thumbnail_weight", [0.0, 0.4])
def test_fused_distance_is_the_weighted_sum_of_its_terms(encoder, thumbnail_weight):
    settings = CascadeSettings(vector_weight=0.3, thumbnail_weight=thumbnail_weight, verify=False, ranked=12)
    fused = FusedRecognizer(encoder, settings)
    a, b = (fused.describe(DEFAULT[i]) for i in (0, 5))
    expected = 0.7 * ComplexityRecognizer(encoder).distance(a, b) + 0.3 * CosineRecognizer(encoder).distance(
        a, b
    )
    if thumbnail_weight:
        thumbnails = RangeThumbnails()
        thumbnails.add(range_thumbnail(DEFAULT[5]))
        seen = thumbnails.distances(range_thumbnail(DEFAULT[0]))[0]
        expected = (1 - thumbnail_weight) * expected + thumbnail_weight * seen
    assert fused.distance(a, b) == pytest.approx(expected, abs=1e-6)
    for image in DEFAULT:
        fused.add(fused.describe(image))
    found = fused.query(a, k=12)
    assert found[0].place == 0
    assert found == sorted(found, key=lambda m: m.distance)
    for match in found:
        assert match.distance == pytest.approx(
            fused.distance(a, fused.describe(DEFAULT[match.place])), abs=1e-4
        )


@pytest.mark.parametrize(
    "stages",
    [
        {"exact": False},
        {"vectors": False},
        {"relaxed": False},
        {"vectors": False, "relaxed": False},
    ],
)
def test_every_ablation_without_geometry_finds_the_same_frame_again(encoder, stages):
    recognizer = make_cascade(encoder, CascadeSettings(verify=False, **stages))
    for image in DEFAULT:
        recognizer.add(recognizer.describe(image))
    for number in (1, 7):
        assert recognizer.query(recognizer.describe(DEFAULT[number]))[0].place == number
    assert recognizer.query(recognizer.describe(DEFAULT[7]), limit=0) == []


def test_relaxed_bounds_thin_proposals_out(encoder):
    fused = FusedRecognizer(encoder, CascadeSettings(proposed=10, ranked=3, verify=False))
    for image in DEFAULT:
        fused.add(fused.describe(image))
    assert len(fused.query(fused.describe(DEFAULT[2]), k=1)) == 1
    assert len(fused.query(fused.describe(DEFAULT[2]), k=3)) == 3
    spread = FusedRecognizer(encoder, CascadeSettings(proposed=12, ranked=12, spread=4))
    for image in DEFAULT:
        spread.add(spread.describe(image))
    places = [m.place for m in spread.query(fused.describe(DEFAULT[2]), k=12)]
    assert places[0] == 2
    assert all(abs(a - b) >= 4 for i, a in enumerate(places) for b in places[:i])


def ahead(seed: int, yaw: float) -> RangeImage:
    ranges = block_world(seed).cast(STEREO, pose_at(STEREO, 0.0, 0.0, yaw, 1.6))
    return RangeImage(ranges, STEREO, sensor_height_m=1.6)


@pytest.mark.parametrize("degrees", [20.0, -24.0])
def test_a_place_entered_from_a_bend_is_among_the_turned(encoder, degrees):
    fused = FusedRecognizer(encoder, CascadeSettings(spread=1))
    for seed in (3, 4, 5, 6):
        fused.add(fused.describe(ahead(seed, 0.0)))
    best = fused.turned(fused.describe(ahead(4, math.radians(degrees))), 1)[0]
    assert best.place == 1
    turn = -best.shift * math.degrees(STEREO.horizontal_fov_rad)
    assert turn == pytest.approx(degrees, abs=6.0)
    assert fused.turned(fused.describe(ahead(4, 0.3)), 1, limit=0) == []


def test_no_place_is_turned_on_a_full_circle():
    lidar = Encoder(small("lidar")).fit(
        [
            RangeImage(
                block_world(7).cast(SPINNING, pose_at(SPINNING, 0.0, 0.0, 0.5 * i, 1.6)),
                SPINNING,
                sensor_height_m=1.6,
            )
            for i in range(6)
        ]
    )
    fused = FusedRecognizer(lidar)
    description = fused.describe(
        RangeImage(
            block_world(7).cast(SPINNING, pose_at(SPINNING, 0.0, 0.0, 0.0, 1.6)),
            SPINNING,
            sensor_height_m=1.6,
        )
    )
    fused.add(description)
    assert fused.turned(description, 3) == []


def test_some_distances_of_an_index_are_those_of_all(encoder):
    index = encoder.make_index()
    for image in DEFAULT:
        index.add(encoder.describe(image).signatures)
    query = encoder.describe(boxes(77)).signatures
    items = np.array([7, 0, 7, 3])
    for relaxed in (False, True):
        np.testing.assert_allclose(
            index.distances_of(query, items, relaxed=relaxed),
            index.distances(query, relaxed=relaxed)[items],
            rtol=1e-12,
        )
    assert len(index.distances_of(query, np.array([], dtype=np.int64))) == 0
    for bad in (np.array([12]), np.array([-1]), np.zeros((1, 1), dtype=np.int64)):
        with pytest.raises(DataError, match="12 there are"):
            index.distances_of(query, bad)


def over_what_others_reach(found):
    """Share of the way from the agreement that other places often reach to full agreement."""
    assert 0 < found.reached_elsewhere < found.agreement
    return (found.agreement - found.reached_elsewhere) / (1 - found.reached_elsewhere)


def test_geometry_overrules_a_wrong_first_proposal():
    recognizer = VerifiedRecognizer(Listed([0.1, 0.9, 0.3]), k=3, spread=1)
    for seed in (0, 1, 2):
        recognizer.add(recognizer.describe(row_at(seed, 0.0)))
    found = recognizer.query(recognizer.describe(row_at(1, 0.7)), k=3)
    assert found[0].place == 1
    assert found[0].verification.accepted
    assert found[0].distance == pytest.approx(
        1 - over_what_others_reach(found[0].verification) / math.sqrt(1.9)
    )
    assert found[0].distance < 1
    assert [(m.place, m.verification.accepted) for m in found[1:]] == [(0, False), (2, False)]
    assert found[1].distance == pytest.approx(1 + 0.1 / 1.1)
    assert 1 < found[1].distance < found[2].distance < 2


def test_only_the_best_few_are_checked():
    recognizer = VerifiedRecognizer(Listed([0.1, 0.9, 0.3]), k=1, spread=1, pool=3)
    for seed in (0, 1, 2):
        recognizer.add(recognizer.describe(row_at(seed, 0.0)))
    found = recognizer.query(recognizer.describe(row_at(1, 0.5)), k=3)
    assert [m.verification is None for m in found] == [False, True, True]
    assert not found[0].verification.accepted
    assert recognizer.query(recognizer.describe(row_at(1, 0.5)), limit=0) == []
    assert len(recognizer.query(recognizer.describe(row_at(1, 0.5)), k=9, limit=2)) == 2


def test_of_planar_scans_the_proposal_that_correlates_best_is_checked_first():
    checked = {}
    for correlated in (0, 3, 2):
        recognizer = VerifiedRecognizer(
            Listed([0.1, 0.3, 0.9, 0.95]), k=1, spread=1, correlated=correlated, climb=False
        )
        for seed in (0, 3, 1, 2):
            recognizer.add(recognizer.describe(row_at(seed, 0.0)))
        found = recognizer.query(recognizer.describe(row_at(1, 0.4)), k=4)
        checked[correlated] = {m.place for m in found if m.verification is not None}
    # The right place is the third proposed.
    assert checked[0] == {0}
    assert checked[3] == {2}
    assert checked[2] <= {0, 1}


def test_climbing_names_the_neighbour_seen_from_nearest():
    track = [row_at(4, -2.0 + i) for i in range(PLACES)]
    query = row_at(4, 3.1)
    named = []
    for climb in (False, True):
        recognizer = VerifiedRecognizer(
            Listed([9.0, 9.0, 0.1, *[9.0] * (PLACES - 3)]), k=1, spread=1, climb=climb
        )
        for image in track:
            recognizer.add(recognizer.describe(image))
        best = recognizer.query(recognizer.describe(query))[0]
        assert best.verification.accepted
        named.append(best)
    assert named[0].place == 2
    assert named[1].verification.nearness >= named[0].verification.nearness
    assert named[1].distance <= named[0].distance
    if named[0].verification.nearness <= 0.6:
        assert abs(named[1].place - 5) < 3


class LedOnly(GeometricVerifier):
    """Refuses one view unless it is told where to start from, and is never certain."""

    def __init__(self, shy):
        super().__init__()
        self.shy = shy

    def verify(self, query, match, *, starts=(), **options):
        found = super().verify(query, match, starts=starts, **options)
        if match is self.shy and not starts:
            return replace(found, accepted=False, agreement=0.0)
        return replace(found, agreement=min(0.4, found.agreement) + 0.1 * (match is self.shy))


def test_climbing_asks_again_for_a_neighbour_that_the_search_refused():
    descriptions = [VerifiedDescription(f"place {i}", make_depth_view(row_at(4, float(i)))) for i in range(2)]
    recognizer = VerifiedRecognizer(Listed([0.1, 0.2]), k=2, spread=1, verifier=LedOnly(descriptions[1].view))
    for description in descriptions:
        recognizer.add(description)
    best = recognizer.query(VerifiedDescription("query", make_depth_view(row_at(4, 0.9))), k=2)[0]
    assert best.place == 1
    assert best.verification.accepted


class FirstAlone(GeometricVerifier):
    """Of one query's checks all fail but that against the first place."""

    def __init__(self, query, first):
        super().__init__()
        self.query, self.first = query, first

    def verify(self, query, match, **options):
        found = super().verify(query, match, **options)
        return replace(found, accepted=False, agreement=0.0) if self.fails(query, match) else found

    def fails(self, query, match):
        return query is self.query and match is not self.first


@pytest.mark.parametrize("within_m", [0.5, math.inf])
def test_a_match_seen_from_afar_is_named_after_the_place_that_motion_puts_nearest(within_m):
    def described(x):
        view = make_depth_view(row_at(4, x))
        settings = replace(view.settings, named_within_m=within_m, min_agreement=0.1)
        return VerifiedDescription(x, replace(view, settings=settings))

    places, query = [described(0.6 * i) for i in range(4)], described(2.0)
    verifier = FirstAlone(query.view, places[0].view)
    recognizer = VerifiedRecognizer(
        Listed([0.1, 0.2, 0.3, 0.4]), k=4, spread=1, track=True, verifier=verifier
    )
    for place in places:
        recognizer.add(place)
    found = recognizer.query(query, k=4)
    named = found[0].verification
    assert named.accepted
    assert found[0].place == (3 if math.isfinite(within_m) else 0)
    assert named.offset_m == pytest.approx(abs(2.0 - 0.6 * found[0].place), abs=0.1)
    assert ("found beside place 0" in named.reason) == math.isfinite(within_m)
    assert len({match.place for match in found}) == len(found)
    # Of fewer places the nearest of these is named.
    assert recognizer.query(query, k=4, limit=2)[0].place == (1 if math.isfinite(within_m) else 0)


def test_neighbouring_frames_second_a_place_that_nobody_proposes():
    distances = [0.1] + [9.0] * (PLACES - 1)
    outcomes = {}
    for consistency in (0, 3):
        inner = Listed(distances)
        recognizer = VerifiedRecognizer(inner, k=1, spread=1, consistency=consistency, pool=1, climb=False)
        for i in range(4):
            recognizer.add(recognizer.describe(row_at(4, 0.6 * i)))
        inner.distances = [9.0, 0.1, 9.0, 9.0, *[9.0] * 9]
        first = recognizer.describe(row_at(4, 0.7))
        assert recognizer.query(first, limit=4)[0].place == 1
        recognizer.add(first)
        inner.distances = [0.1, 9.0, 9.0, 9.0, *[9.0] * 9]
        inner.query = lambda description, k=1, limit=None: [PlaceMatch(3, 0.1)]
        outcomes[consistency] = {
            m.place for m in recognizer.query(recognizer.describe(row_at(4, 0.8)), k=9, limit=4)
        }
    assert outcomes[0] == {3}
    assert 1 in outcomes[3]


def test_asking_twice_gives_the_same_answer_and_fit_forgets():
    recognizer = VerifiedRecognizer(Listed([0.1, 0.2, 0.3, 0.4]), k=2, spread=1, consistency=3)
    for seed in (0, 1, 2):
        recognizer.add(recognizer.describe(row_at(seed, 0.0)))
    query = recognizer.describe(row_at(1, 0.4))
    first, second = recognizer.query(query)[0], recognizer.query(query)[0]
    assert (first.place, first.distance) == (second.place, second.distance) == (1, first.distance)
    assert recognizer.fit([]).query(query) == []


def test_shift_of_the_descriptor_turns_the_view_of_a_spinning_sensor():
    scene, turn = block_world(5), 2 * math.pi * 10 / 60

    def frame(yaw: float) -> RangeImage:
        ranges = scene.cast(SPINNING, pose_at(SPINNING, 0.0, 0.0, yaw, 1.6))
        return RangeImage(ranges, SPINNING, sensor_height_m=1.6)

    lidar = Encoder(small("lidar")).fit([frame(0.4 * i) for i in range(8)])
    recognizer = make_place_recognizer("detector", "lidar", lidar)
    recognizer.add(recognizer.describe(frame(0.0)))
    best = recognizer.query(recognizer.describe(frame(turn)))[0]
    assert best.verification.accepted
    assert best.shift is not None
    T = best.verification.T_match_query
    assert math.atan2(T[1, 0], T[0, 0]) == pytest.approx(turn, abs=0.02)
    assert best.shift * 2 * math.pi / 60 == pytest.approx(-turn % (2 * math.pi), abs=0.25)


@pytest.mark.parametrize("name", [n for n in PLACE_METHODS if n.startswith("detector-no-")])
def test_every_ablation_of_the_detector_lacks_what_its_name_says(name, encoder, monkeypatch):
    monkeypatch.setattr(training, "training_images", lambda preset: DEFAULT)
    made: list[tuple[Encoder, CascadeSettings]] = []
    monkeypatch.setattr(assembly, "make_cascade", lambda e, settings, views=None: made.append((e, settings)))
    for method in ("detector", name):
        make_place_recognizer(method, "street", encoder)
    (_, whole), (coded, ablated) = made
    assert (coded.settings, ablated) != (encoder.settings, whole)
    stage = {"turned": "turned", "thumbnails": "thumbnail_weight"}.get(name[12:], name[12:])
    if hasattr(ablated, stage):
        assert not getattr(ablated, stage)


@pytest.mark.parametrize("name", ["detector", "pixel-l2+geometry", "cosine+geometry"])
def test_registry_builds_methods_with_geometry(name, encoder):
    views = ViewCache()
    recognizer = make_place_recognizer(name, "street", encoder, views)
    descriptions = [recognizer.describe(image) for image in DEFAULT[:3]]
    assert [recognizer.add(d) for d in descriptions] == [0, 1, 2]
    best = recognizer.query(descriptions[1])[0]
    assert best.place == 1
    assert best.verification.accepted
    assert best.distance < 0.2
    assert best.distance == pytest.approx(recognizer.distance(descriptions[1], descriptions[1]), abs=0.05)


def test_unknown_method_with_geometry_says_how_names_are_made(encoder):
    with pytest.raises(SettingsError, match=r"\+geometry, got 'magic\+geometry'"):
        make_place_recognizer("magic+geometry", "street", encoder)


def test_methods_share_a_frame_s_view():
    views = ViewCache()
    image, other = row_at(0, 0.0), row_at(1, 0.0)
    assert views(image) is views(image)
    assert views(other) is not views(image)
    np.testing.assert_array_equal(views(image).counted, make_depth_view(image).counted)


def test_detector_explains_what_geometry_decided():
    recognizer = VerifiedRecognizer(Listed([0.1, 0.2, 0.3, 0.4, 0.5]), k=4, spread=1)
    detector = LoopClosureDetector(recognizer, exclusion_gap=0, threshold=1.0)
    detector.add(row_at(0, 0.0))
    refused = detector.process(row_at(1, 0.0))
    assert refused.status is LoopStatus.FAILED_GEOMETRY
    assert "geometric check refused it: " in refused.explain()
    assert refused.T_match_query is None
    closed = detector.process(row_at(0, 0.6))
    assert closed.status is LoopStatus.ACCEPTED
    assert closed.match == 0
    assert np.linalg.norm(closed.T_match_query[:3, 3]) == pytest.approx(0.6, abs=0.1)
    assert closed.inliers > 50
    assert closed.overlap > 0.45
    assert closed.score == -closed.distance
    assert "of the views agree" in closed.explain()


def test_verified_pairs_agree_with_the_verifier():
    recognizer = VerifiedRecognizer(Listed([0.0]))
    a, b = (recognizer.describe(row_at(1, x)) for x in (0.0, 0.5))
    found = GeometricVerifier().verify(a.view, b.view)
    assert found.accepted
    assert recognizer.distance(a, b) == pytest.approx(1 - over_what_others_reach(found) / math.sqrt(1.5))
    other = recognizer.describe(row_at(2, 0.0))
    assert recognizer.distance(a, other) == pytest.approx(1 + 0.5 / 1.5)


def test_rankings_propose_in_turn_and_never_one_place_twice():
    ranks = [np.array(r) for r in ([5, 6, 20, 9, 0], [6, 30, 21, 12])]
    assert taken_in_turn(ranks, 40, 9, 1).tolist() == [5, 6, 20, 30, 9, 21, 0, 12]
    assert taken_in_turn(ranks, 40, 9, 4).tolist() == [5, 30, 20, 12, 0]
    assert taken_in_turn(ranks, 40, 3, 4).tolist() == [5, 30, 20]
    assert taken_in_turn([ranks[0][:0], ranks[1]], 40, 2, 1).tolist() == [6, 30]


def test_columns_propose_what_the_codes_do_not(encoder):
    """Every code is the same here, so only the map can tell the places apart."""
    fused = FusedRecognizer(encoder, CascadeSettings(ranked=2, spread=1, columns=True))
    blind = FusedRecognizer(encoder, CascadeSettings(ranked=2, spread=1, columns=False))
    coded = encoder.describe(DEFAULT[0])
    for image in DEFAULT:
        own = fused.describe(image)
        for recognizer in (fused, blind):
            recognizer.add(replace(own, signatures=coded.signatures, vectors=coded.vectors))
    asked = replace(fused.describe(DEFAULT[9]), signatures=coded.signatures, vectors=coded.vectors)
    assert 9 in [match.place for match in fused.query(asked, k=2)]
    assert 9 not in [match.place for match in blind.query(asked, k=2)]


def test_a_description_without_what_the_settings_compare_is_refused(encoder):
    fused = FusedRecognizer(encoder, CascadeSettings(thumbnail_weight=0.3))
    plain = encoder.describe(DEFAULT[0])
    for ask in (fused.add, lambda d: fused.distance(d, d)):
        with pytest.raises(DataError, match="thumbnail"):
            ask(plain)
    assert fused.query(fused.describe(DEFAULT[0])) == []


def test_spread_proposals_keep_their_order():
    matches = [PlaceMatch(p, d / 10) for d, p in enumerate((10, 11, 30, 13, 14, 29))]
    assert [m.place for m in spread_in_time(matches, 3, 4)] == [10, 30, 14]
    assert [m.place for m in spread_in_time(matches, 2, 1)] == [10, 11]
    assert spread_in_time([], 2, 1) == []


@pytest.mark.parametrize(
    "bad",
    [
        {"proposed": 0},
        {"ranked": 0},
        {"verified": 0},
        {"spread": 0},
        {"turned": -1},
        {"correlated": -1},
        {"vector_weight": 1.5},
        {"vectors": False, "exact": False},
        {"thumbnail_weight": -0.1},
        {"thumbnail_weight": 1.1},
    ],
)
def test_settings_that_cannot_be_raise(bad):
    with pytest.raises(SettingsError):
        CascadeSettings(**bad)


@pytest.mark.parametrize(
    "bad", [{"k": 0}, {"spread": 0}, {"consistency": -1}, {"correlated": -1}, {"pool": 0}]
)
def test_wrapper_settings_that_cannot_be_raise(bad):
    with pytest.raises(SettingsError, match="got"):
        VerifiedRecognizer(Listed([]), **bad)
