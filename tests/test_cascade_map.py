"""The cascade detector over a saved map: places come back with what geometry needs of them."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint import LoopClosureDetector, PlaceDatabase, load_shipped_encoder
from depthprint.cascade.assembly import make_cascade
from depthprint.cascade.settings import CascadeSettings
from depthprint.errors import DataError
from depthprint.verification import make_depth_view
from depthprint.verification.view_arrays import pack_view, unpack_view
from synthetic import boxes, scan


@pytest.mark.parametrize("image", [boxes(1), scan(2)])
def test_a_view_comes_back_from_its_arrays(image):
    view = make_depth_view(image)
    again = unpack_view(pack_view(view))
    assert again.projection == view.projection
    assert again.settings == view.settings
    assert again.ranges_m.tobytes() == view.ranges_m.tobytes()
    np.testing.assert_array_equal(again.counted, view.counted)
    arrays = pack_view(view)
    del arrays["view_counted"]
    with pytest.raises(DataError, match="view_counted"):
        unpack_view(arrays)


def test_the_cascade_localises_in_a_saved_map_as_in_its_own_memory(tmp_path):
    pytest.importorskip("small_gicp")
    encoder = load_shipped_encoder("handheld")
    path = tmp_path / "map.db"
    straight = LoopClosureDetector(make_cascade(encoder), exclusion_gap=0, threshold=1.0)
    with PlaceDatabase.create(path, encoder) as database:
        mapping = LoopClosureDetector(
            make_cascade(encoder), exclusion_gap=0, threshold=1.0, database=database
        )
        for seed in range(5):
            mapping.add(boxes(seed, height_m=None))
            straight.add(boxes(seed, height_m=None))
    with PlaceDatabase.open(path, read_only=True) as database:
        again = LoopClosureDetector(
            make_cascade(database.load_encoder()), exclusion_gap=0, threshold=1.0, database=database
        )
        found, expected = (d.query(boxes(3, height_m=None)) for d in (again, straight))
    assert found.match == expected.match == 3
    assert found.accepted
    assert found.distance == expected.distance
    np.testing.assert_array_equal(found.T_match_query, expected.T_match_query)


def test_a_map_from_before_thumbnails_says_what_it_lacks_and_opens_without_them(tmp_path):
    encoder = load_shipped_encoder("handheld")
    path = tmp_path / "old.db"
    before = CascadeSettings(thumbnail_weight=0.0, columns=False, verify=False)
    with PlaceDatabase.create(path, encoder) as database:
        mapping = LoopClosureDetector(make_cascade(encoder, before), threshold=1.0, database=database)
        for seed in range(3):
            mapping.add(boxes(seed, height_m=None))
    with PlaceDatabase.open(path, read_only=True) as database:
        with pytest.raises(DataError, match=r"'thumbnail'.*thumbnail_weight=0"):
            LoopClosureDetector(
                make_cascade(encoder, CascadeSettings(verify=False)), threshold=1.0, database=database
            )
        again = LoopClosureDetector(
            make_cascade(encoder, before), exclusion_gap=0, threshold=1.0, database=database
        )
        assert again.query(boxes(2, height_m=None)).match == 2
