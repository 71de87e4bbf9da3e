"""One contract for every method that recognises places."""

import numpy as np
import pytest

from depthprint import place_methods
from depthprint.encoder import Encoder
from depthprint.errors import SettingsError
from depthprint.place_methods import PLACE_METHODS, make_place_recognizer
from depthprint.projection import Spherical
from depthprint.range_image import RangeImage
from depthprint.simulation import training
from synthetic import boxes
from test_encoder import DEFAULT, IMAGES, small

# The detector searches its own proposals only, and checks them: test_cascade.py has its contract.
# map-closures proposes only places that its package can align; tests/test_map_closures.py has its own contract
QUICK = [n for n in PLACE_METHODS if n not in ("ncd-zstd", "map-closures") and not n.startswith("detector")]
# These score a place by more than the pair: by the rest of the map, or by the frames before.
BY_CONTEXT = ("fabmap2", "seqslam")
PRESETS_OF_PLACES = ("street", "handheld", "laser", "lidar")


@pytest.fixture(autouse=True)
def _small_shipped_models(monkeypatch):
    """Train the literal preset's model here: the shipped one has more atoms than these images can show."""
    literal = Encoder(small("literal")).fit(DEFAULT)
    monkeypatch.setattr(place_methods, "load_shipped_encoder", lambda preset: literal)
    monkeypatch.setattr(training, "training_images", lambda preset: IMAGES.get(preset, DEFAULT))


@pytest.fixture(scope="module")
def models():
    return {p: Encoder(small(p)).fit(IMAGES.get(p, DEFAULT)) for p in PRESETS_OF_PLACES}


@pytest.fixture(params=[(m, "street") for m in QUICK] + [(m, "handheld") for m in ("emd", "cosine", "emd-relaxed")]
                + [(m, p) for p in ("laser", "lidar") for m in ("emd", "cosine", "scan-context-like", "pixel-l2")]
                + [(m, p) for p in ("laser", "lidar") for m in ("scan-context", "m2dp", "seqslam", "fabmap2")],
                ids="-".join)  # fmt: skip
def case(request, models):
    name, preset = request.param
    if name in BY_CONTEXT and "pairwise" in request.node.keywords:
        pytest.skip("scores a place by more than the pair")
    return make_place_recognizer(name, preset, models[preset]), IMAGES.get(preset, DEFAULT)


def test_an_empty_recogniser_proposes_nothing(case):
    recognizer, images = case
    assert recognizer.query(recognizer.describe(images[0])) == []


@pytest.mark.pairwise
def test_places_are_numbered_in_order_and_each_is_nearest_to_itself(case):
    recognizer, images = case
    descriptions = [recognizer.describe(image) for image in images]
    assert [recognizer.add(d) for d in descriptions] == list(range(len(images)))
    for number, description in enumerate(descriptions):
        best = recognizer.query(description, k=1)[0]
        assert best.distance == pytest.approx(
            recognizer.distance(description, descriptions[best.place]), abs=1e-4
        )
        assert best.distance == pytest.approx(
            recognizer.distance(description, descriptions[number]), abs=1e-4
        )


@pytest.mark.pairwise
def test_a_query_returns_the_k_smallest_distances_in_order(case):
    recognizer, images = case
    descriptions = [recognizer.describe(image) for image in images]
    for description in descriptions[1:]:
        recognizer.add(description)
    found = recognizer.query(descriptions[0], k=4)
    every = sorted(recognizer.distance(descriptions[0], d) for d in descriptions[1:])
    assert np.allclose([m.distance for m in found], every[:4], atol=1e-4)
    assert len({m.place for m in found}) == 4


def test_k_different_places_come_back_nearest_first(case):
    recognizer, images = case
    descriptions = [recognizer.describe(image) for image in images]
    assert [recognizer.add(d) for d in descriptions] == list(range(len(images)))
    found = recognizer.query(descriptions[3], k=5)
    assert len({m.place for m in found}) == 5
    assert [m.distance for m in found] == sorted(m.distance for m in found)
    assert recognizer.query(descriptions[3], k=5) == found


def test_only_places_below_the_limit_are_looked_at(case):
    recognizer, images = case
    descriptions = [recognizer.describe(image) for image in images]
    for description in descriptions:
        recognizer.add(description)
    assert {m.place for m in recognizer.query(descriptions[5], k=20, limit=3)} == {0, 1, 2}
    assert recognizer.query(descriptions[5], limit=0) == []


def test_describing_twice_gives_the_same_distance_of_zero(case):
    recognizer, images = case
    same = recognizer.distance(recognizer.describe(images[2]), recognizer.describe(images[2]))
    other = recognizer.distance(recognizer.describe(images[2]), recognizer.describe(images[3]))
    assert same < other


def test_unknown_method_lists_the_known_ones():
    with pytest.raises(SettingsError, match="scan-context-like"):
        make_place_recognizer("magic", "street")


def test_scan_context_like_finds_the_shift_of_a_turned_view(models):
    recognizer = make_place_recognizer("scan-context-like", "street", models["street"])
    columns = 4 * models["street"].settings.polar.sectors
    fan = Spherical(columns, 48, -0.6, 0.6, -0.4, 0.2)
    for seed in range(6):
        recognizer.add(recognizer.describe(boxes(seed, fan)))
    turned = RangeImage(np.roll(boxes(4, fan).ranges_m, 2 * 4, axis=1), fan, sensor_height_m=1.5)
    best = recognizer.query(recognizer.describe(turned))[0]
    assert best.place == 4
    assert best.shift == -2


@pytest.mark.parametrize(
    ("preset", "checked", "correlated"),
    [("street", 4, 0), ("lidar", 4, 0), ("handheld", 10, 0), ("laser", 5, 40)],
)
def test_geometry_looks_at_as_many_places_of_a_rival_as_of_the_detector(
    models, monkeypatch, preset, checked, correlated
):
    import depthprint.cascade.assembly
    import depthprint.cascade.verified_recognizer

    asked = []

    class Counted(depthprint.cascade.verified_recognizer.VerifiedRecognizer):
        def __init__(self, inner, k, *, correlated, **rest):
            asked.append((k, correlated))
            super().__init__(inner, k, correlated=correlated, **rest)

    monkeypatch.setattr(depthprint.cascade.assembly, "VerifiedRecognizer", Counted)
    monkeypatch.setattr(depthprint.cascade.verified_recognizer, "VerifiedRecognizer", Counted)
    for name in ("detector", "scan-context-like+geometry"):
        make_place_recognizer(name, preset, models[preset])
    assert asked == [(checked, correlated)] * 2
