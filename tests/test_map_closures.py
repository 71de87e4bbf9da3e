"""The adapter for the package map-closures: its own contract, since places that do not align are not proposed."""

from __future__ import annotations

import builtins

import numpy as np
import pytest

from depthprint.errors import MissingExtraError, SettingsError
from depthprint.place_methods import make_place_recognizer
from depthprint.projection import Spherical
from depthprint.range_image import RangeImage

SENSOR = Spherical(720, 24)


def street_scene(seed: int, turn: int = 0) -> RangeImage:
    """Walls and posts about a spinning sensor, turned by columns."""
    rng = np.random.default_rng(seed)
    ranges = np.full(SENSOR.width, 25.0) + 4 * np.sin(np.linspace(0, 6 * np.pi, SENSOR.width) + seed)
    for _ in range(60):
        start, width = int(rng.integers(0, SENSOR.width)), int(rng.integers(4, 16))
        ranges[np.arange(start, start + width) % SENSOR.width] = rng.uniform(4, 22)
    image = np.repeat(np.roll(ranges, turn)[None], SENSOR.height, axis=0)
    return RangeImage(image.astype(np.float32), SENSOR, sensor_height_m=1.7)


def test_a_place_is_found_again_and_newer_ones_are_not_looked_at():
    pytest.importorskip("map_closures")
    recognizer = make_place_recognizer("map-closures", "lidar")
    images = [street_scene(seed) for seed in range(6)]
    assert recognizer.query(recognizer.describe(images[0])) == []
    described = [recognizer.describe(image) for image in images]
    assert [recognizer.add(d) for d in described] == list(range(6))
    found = recognizer.query(recognizer.describe(images[3]), k=6)
    assert found[0].place == 3
    assert recognizer.query(recognizer.describe(images[3]), k=1)[0].place == 3
    assert all(m.place < 2 for m in recognizer.query(recognizer.describe(images[3]), k=6, limit=2))
    assert recognizer.query(described[3], limit=0) == []
    same, other = (
        recognizer.distance(described[3], described[3]),
        recognizer.distance(described[3], described[4]),
    )
    assert same < other


def test_a_query_that_is_then_added_becomes_one_place():
    pytest.importorskip("map_closures")
    recognizer = make_place_recognizer("map-closures", "lidar")
    for seed in range(3):
        described = recognizer.describe(street_scene(seed))
        recognizer.query(described)
        assert recognizer.add(described) == seed
    assert recognizer.query(recognizer.describe(street_scene(1)))[0].place == 1


def test_without_the_package_the_error_holds_the_pip_line(monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.startswith("map_closures"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match=r"pip install 'depthprint\[map-closures\]'"):
        make_place_recognizer("map-closures", "street")


def test_settings_that_cannot_be_are_refused():
    from depthprint.baselines.map_closures import MapClosuresRecognizer

    with pytest.raises(SettingsError, match="resolution_m > 0"):
        MapClosuresRecognizer(resolution_m=0.0)
