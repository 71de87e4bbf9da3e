"""Simulated objects: seeded shape grammars on a table, rendered as masked crops."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from depthprint.errors import SettingsError
from depthprint.projection import Pinhole
from depthprint.simulation.object_shapes import Proportions, _extent, grow
from depthprint.simulation.objects import CAMERA, _orbit, _window, simulated_objects


@pytest.fixture(scope="module")
def objects():
    return simulated_objects(6, 3, 2, seed=1)


def test_views_are_laid_out_as_the_uw_set(objects):
    assert objects.simulated
    assert objects.elevation_deg == {1: 30.0, 2: 45.0, 4: 60.0}
    assert len(objects.views) == 6 * 3 * 3 * 2
    assert len({view.path for view in objects.views}) == len(objects.views)
    assert Counter(view.category for view in objects.views) == {f"shape{c:02d}": 18 for c in range(1, 7)}
    assert {view.instance for view in objects.views if view.category == "shape02"} == {
        "shape02_1", "shape02_2", "shape02_3",
    }  # fmt: skip
    assert {view.frame for view in objects.views} == {1, 2}


def test_same_seed_gives_the_same_bits_in_any_reading_order(objects):
    again = simulated_objects(6, 3, 2, seed=1)
    for view in (objects.views[-1], objects.views[0], objects.views[40]):
        one, other = objects.read(view), again.read(view)
        np.testing.assert_array_equal(one.ranges_m, other.ranges_m)
        np.testing.assert_array_equal(one.mask, other.mask)


def test_an_object_does_not_depend_on_how_many_others_there_are(objects):
    few = simulated_objects(2, 2, 2, seed=1)
    view = few.views[-1]
    np.testing.assert_array_equal(few.read(view).ranges_m, objects.read(view).ranges_m)


def test_other_seeds_give_other_objects(objects):
    other = simulated_objects(6, 3, 2, seed=2)
    shapes = [(objects.read(v).shape, other.read(v).shape) for v in objects.views[::6]]
    assert sum(a != b for a, b in shapes) > len(shapes) / 2


def test_crops_hold_the_object_with_a_margin_of_table(objects):
    for view in objects.views[::5]:
        image = objects.read(view)
        assert isinstance(image.projection, Pinhole)
        assert image.projection.fx == 575.8
        assert image.mask.any()
        rim = np.concatenate([image.mask[0], image.mask[-1], image.mask[:, 0], image.mask[:, -1]])
        assert not rim.any(), "the mask keeps clear of the crop's rim"
        assert image.valid[image.mask].mean() > 0.7
        assert image.valid[~image.mask].mean() > 0.5
        assert 0.6 < np.nanmedian(image.ranges_m) < 1.3


def test_background_is_a_level_table(objects):
    for view in objects.views[::7]:
        image = objects.read(view)
        elevation = np.radians(objects.elevation_deg[view.video])
        table = image.points()[image.valid & ~image.mask].astype(float)
        up = np.array([0.0, -np.cos(elevation), -np.sin(elevation)])
        heights_m = table @ up
        assert np.ptp(np.quantile(heights_m, [0.05, 0.95])) < 0.02


def test_holes_are_nan(objects):
    holes = [~objects.read(view).valid for view in objects.views[::9]]
    assert all(hole.any() for hole in holes)


def test_instances_share_a_grammar_but_not_proportions():
    for category in range(12):
        grown = [_grown(category, instance) for instance in range(3)]
        assert len({len(triangles) for triangles in grown}) == 1, "the same parts"
        sizes = [np.subtract(*_extent(triangles)[::-1]) for triangles in grown]
        assert not np.allclose(sizes[0], sizes[1], rtol=0.01)
        assert not np.allclose(sizes[0], sizes[2], rtol=0.01)


def test_objects_stand_on_the_table_at_the_size_of_household_things():
    for category in range(40):
        low, high = _extent(_grown(category, 0))
        assert low[2] == pytest.approx(0, abs=1e-6)
        assert 0.07 < (high - low).max() < 0.30
        np.testing.assert_allclose((low + high)[:2], 0, atol=1e-6)


def test_categories_differ():
    parts = {len(_grown(category, 0)) for category in range(30)}
    assert len(parts) > 10


def test_orbit_looks_at_the_object_from_the_elevation_asked_for():
    for elevation in np.radians([30, 45, 60]):
        pose = _orbit(elevation, 0.7, 1.1)
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
        assert np.arcsin(-pose[2, 2]) == pytest.approx(elevation)
        u, v, z = CAMERA.project((np.array([[0, 0, 0.05]]) - pose[:3, 3]) @ pose[:3, :3])
        np.testing.assert_allclose([u[0], v[0], z[0]], [CAMERA.cx, CAMERA.cy, 1.1])


def test_window_holds_every_corner():
    triangles, pose = _grown(3, 1), _orbit(0.6, 0.2, 1.0)
    left, top, right, bottom = _window(triangles, pose)
    u, v, _ = CAMERA.project((triangles.reshape(-1, 3) - pose[:3, 3]) @ pose[:3, :3])
    assert left + 9 < u.min() < left + 12
    assert right - 13 < u.max() < right - 9
    assert top + 9 < v.min() < top + 12
    assert bottom - 13 < v.max() < bottom - 9


@pytest.mark.parametrize("wrong", [{"n_categories": 0}, {"n_instances": 0}, {"frames": 0}, {"seed": -1}])
def test_counts_out_of_range_are_refused(wrong):
    with pytest.raises(SettingsError, match=f"{next(iter(wrong))}: expected a whole number"):
        simulated_objects(**wrong)


def test_view_of_another_set_is_refused(objects):
    with pytest.raises(SettingsError, match="its own views"):
        objects.read(replace(objects.views[0], frame=99))


def _grown(category: int, instance: int):
    grammar = np.random.default_rng([5, category])
    return grow(Proportions(grammar, np.random.default_rng([5, category, instance])))
