"""Views turned a little: against true views from there, on analytic surfaces and ray-cast solids, all simulated."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from depthprint.baselines.kernel_descriptors.patch_grid import mirrored_image
from depthprint.errors import DataError, SettingsError
from depthprint.objects.linear_methods import KernelDescriptorViews
from depthprint.objects.methods import make_object_methods
from depthprint.projection import Pinhole, Spherical
from depthprint.range_image import RangeImage
from depthprint.simulation.meshes import box, merge
from depthprint.simulation.objects import simulated_objects
from depthprint.simulation.ray_casting import RayScene
from depthprint.turned_views import TURNS_DEG, turned_copies, turned_view

CAMERA = Pinhole(500.0, 500.0, 60.0, 50.0, 120, 100)
TABLETOP = merge([box(-0.06, 0.06, -0.04, 0.04, 0.0, 0.05), box(-0.02, 0.02, -0.02, 0.02, 0.05, 0.1)])


@pytest.fixture(scope="module")
def crops():
    objects = simulated_objects(n_categories=3, n_instances=2, frames=1, seed=6)
    return [objects.read(view) for view in objects.views]


def sphere_m(camera: Pinhole, centre: np.ndarray, radius_m: float) -> np.ndarray:
    rays = camera.directions()
    a, b = (rays**2).sum(-1), rays @ centre
    under_root = b**2 - a * (centre @ centre - radius_m**2)
    return np.where(under_root > 0, (b - np.sqrt(np.maximum(under_root, 0.0))) / a, np.nan)


def seen_points(image: RangeImage) -> np.ndarray:
    return image.points()[image.valid].astype(np.float64)


def motion(up_deg: float, right_deg: float) -> np.ndarray:
    up, right = np.radians([up_deg, right_deg])
    about_x = np.array([[1, 0, 0], [0, np.cos(up), -np.sin(up)], [0, np.sin(up), np.cos(up)]])
    about_y = np.array([[np.cos(right), 0, np.sin(right)], [0, 1, 0], [-np.sin(right), 0, np.cos(right)]])
    return about_x @ about_y


def looking_down(elevation_deg: float) -> np.ndarray:
    """Pose of a camera half a metre from a point above the table, on the negative y side."""
    c, s = np.cos(np.radians(elevation_deg)), np.sin(np.radians(elevation_deg))
    pose = np.eye(4)
    pose[:3, :3] = np.array([[1, 0, 0], [0, -s, c], [0, -c, -s]])
    pose[:3, 3] = np.array([0, 0, 0.04]) - 0.5 * pose[:3, 2]
    return pose


def test_a_view_turned_by_nothing_is_the_object_of_the_view(crops):
    for image in crops[:4]:
        copy = turned_view(image, 0.0, 0.0)
        rows, columns = np.nonzero(image.mask & image.valid)
        again, across = np.nonzero(copy.valid)
        # Lone pixels, which no triangle reaches, are stray returns at the object's edges more often than not.
        assert 0.97 * len(rows) <= len(again) <= len(rows)
        kept = dict(zip(zip(rows, columns, strict=True), image.ranges_m[rows, columns], strict=True))
        down = round(image.projection.cy - copy.projection.cy)
        right = round(image.projection.cx - copy.projection.cx)
        for r, c in zip(again, across, strict=True):
            assert copy.ranges_m[r, c] == pytest.approx(kept[r + down, c + right], abs=1e-5)
        np.testing.assert_array_equal(copy.mask, copy.valid)


@given(up=st.floats(-25, 25), right=st.floats(-25, 25))
@settings(max_examples=15, deadline=None)
def test_a_turned_plane_is_a_plane_turned_as_much(up, right):
    ranges_m = np.full(CAMERA.height * CAMERA.width, 0.6).reshape(CAMERA.height, CAMERA.width)
    image = RangeImage(ranges_m, CAMERA)
    points = seen_points(turned_view(image, up, right))
    normal = motion(up, right) @ [0.0, 0.0, 1.0]
    middle = seen_points(image).mean(0)
    np.testing.assert_allclose((points - middle) @ normal, 0.0, atol=1e-5)
    assert len(points) > 0.7 * ranges_m.size * np.cos(np.radians(up)) * np.cos(np.radians(right))


@given(up=st.floats(-20, 20), right=st.floats(-20, 20))
@example(up=20.0, right=19.9375)
@example(up=-20.0, right=-20.0)
@settings(max_examples=15, deadline=None)
def test_a_turned_sphere_lies_on_the_sphere_with_holes_only_where_it_was_not_seen(up, right):
    centre, radius = np.array([0.01, -0.02, 0.6]), 0.04
    image = RangeImage(sphere_m(CAMERA, centre, radius), CAMERA)
    copy = turned_view(image, up, right)
    middle, R = seen_points(image).mean(0), motion(up, right)
    moved = R @ (centre - middle) + middle
    np.testing.assert_allclose(np.linalg.norm(seen_points(copy) - moved, axis=1), radius, atol=5e-4)
    true_m = sphere_m(copy.projection, moved, radius)
    normals = (copy.projection.directions() * true_m[..., None] - moved) / radius
    # The cosine at which the first view saw each point; the last two pixels before its edge may be in no triangle.
    before = (normals @ R) * radius + centre
    cosine = -((normals @ R) * before).sum(-1) / np.linalg.norm(before, axis=-1)
    # The outline of flat triangles lies a hair inside the sphere's, which the copy sees at a cosine of zero.
    rays = copy.projection.directions()
    here = -(normals * rays).sum(-1) / np.linalg.norm(rays, axis=-1)
    assert copy.valid[(cosine > 0.45) & (here > 0.05)].all()
    assert copy.valid[(cosine > 0.35) & (here > 0.25)].all()
    assert not copy.valid[~np.isfinite(true_m)].any()
    assert not copy.valid[cosine < -0.05].any()


@pytest.mark.parametrize(("up", "right"), [(12.0, 0.0), (-12.0, 0.0), (0.0, 12.0), (0.0, -12.0), (8.0, -8.0)])
def test_a_turned_solid_is_what_a_camera_sees_from_there(up, right):
    scene = RayScene(TABLETOP)
    T_world_sensor = looking_down(40.0)
    before = RangeImage(scene.cast(CAMERA, T_world_sensor), CAMERA)
    copy = turned_view(before, up, right)
    R, middle = motion(up, right), seen_points(before).mean(0)
    T_before_after = np.eye(4)
    T_before_after[:3, :3] = R.T
    T_before_after[:3, 3] = middle - R.T @ middle
    true_m = scene.cast(copy.projection, T_world_sensor @ T_before_after)
    both = copy.valid & np.isfinite(true_m)
    assert np.quantile(np.abs(copy.ranges_m - true_m)[both], 0.95) < 0.001
    assert (copy.valid & ~np.isfinite(true_m)).sum() < 0.02 * copy.valid.sum()
    # Holes lie where the first camera saw nothing, or something else.
    points = copy.projection.points(true_m).astype(np.float64) @ R + T_before_after[:3, 3]
    u, v, z_m = CAMERA.project(points.reshape(-1, 3))
    u, v = np.round(np.nan_to_num(u, nan=-9)).astype(int), np.round(np.nan_to_num(v, nan=-9)).astype(int)
    inside = (u >= 0) & (u < CAMERA.width) & (v >= 0) & (v < CAMERA.height)
    seen = np.zeros(len(z_m), dtype=bool)
    seen[inside] = np.abs(before.ranges_m[v[inside], u[inside]] - z_m[inside]) < 0.002
    seen = seen.reshape(true_m.shape)
    assert seen.sum() > 500
    assert copy.valid[seen].mean() > 0.95
    assert (both & ~seen).sum() < 0.1 * both.sum()


def test_going_up_shows_more_of_the_top():
    scene = RayScene(box(-0.05, 0.05, -0.05, 0.05, 0.0, 0.05))
    before = RangeImage(scene.cast(CAMERA, looking_down(30.0)), CAMERA)

    def height_of_top(image: RangeImage, elevation_deg: float) -> float:
        heights = seen_points(image) @ looking_down(elevation_deg)[2, :3]
        return float(np.mean(heights > heights.max() - 0.005))

    assert height_of_top(turned_view(before, 15.0, 0.0), 45.0) > height_of_top(before, 30.0)
    assert height_of_top(turned_view(before, -15.0, 0.0), 15.0) < height_of_top(before, 30.0)


def test_turning_a_mirror_image_mirrors_the_turned_view(crops):
    for image in crops[:4]:
        one = turned_view(mirrored_image(image), 10.0, 10.0)
        other = mirrored_image(turned_view(image, 10.0, -10.0))
        assert one.shape == other.shape
        # But for the squares of three returns that the split leaves one triangle, or none.
        assert np.mean(one.valid == other.valid) > 0.94
        both = one.valid & other.valid
        assert np.quantile(np.abs(one.ranges_m - other.ranges_m)[both], 0.9) < 0.003


def test_a_view_of_which_too_little_would_stay_is_its_own_copy():
    ranges_m = np.full((40, 40), np.nan, dtype=np.float32)
    ranges_m[::3, ::3] = 0.7
    image = RangeImage(ranges_m, Pinhole(500.0, 500.0, 20.0, 20.0, 40, 40))
    assert turned_copies([image], 15.0, 0.0)[0] is image


def test_what_cannot_be_turned_is_refused():
    image = RangeImage(np.ones((10, 10)), Pinhole(500.0, 500.0, 5.0, 5.0, 10, 10), source="mug.png")
    with pytest.raises(SettingsError, match="60 degrees"):
        turned_view(image, 0.0, 61.0)
    with pytest.raises(SettingsError, match="nan"):
        turned_view(image, float("nan"), 0.0)
    with pytest.raises(DataError, match=r"mug\.png.*none"):
        turned_view(image.replace(mask=np.zeros((10, 10), dtype=bool)), 15.0, 0.0)
    scan = RangeImage(np.ones((4, 8)), Spherical(8, 4), source="scan")
    with pytest.raises(DataError, match="scan: expected a pinhole image, got Spherical"):
        turned_view(scan, 15.0, 0.0)


def test_kernel_descriptors_learn_from_turned_copies_where_asked_to(crops):
    train, test = np.arange(6), np.arange(6, 9)
    found = {}
    for turned in (False, True):
        views = KernelDescriptorViews(("size",), mirror=True, masked=True, turned=turned, n_words=10)
        views.prepare(crops[:9])
        found[turned] = views.products(train, test)
    assert found[True][0].shape == (2 * 6 * (1 + len(TURNS_DEG)),) * 2
    np.testing.assert_allclose(found[True][0][:12, :12], found[False][0], rtol=1e-5)
    np.testing.assert_allclose(found[True][1][:, :12], found[False][1], rtol=1e-5)
    assert np.abs(found[True][0][12:18, 12:18] - found[False][0][:6, :6]).max() > 1e-3


def test_the_row_with_turned_copies_differs_from_the_recogniser_by_them_alone(crops, monkeypatch):
    labels = np.repeat(np.arange(3), len(crops) // 3)
    test = np.arange(0, len(crops), 3)
    train = np.setdiff1d(np.arange(len(crops)), test)

    def scores():
        found = []
        for method in make_object_methods(["no-geometry", "with-turned"]):
            method.prepare(crops)
            found.append(method.scores(train, labels[train], test)[0])
        return found

    plain, learned = scores()
    monkeypatch.setattr(
        "depthprint.objects.surface_comparisons.turned_copies", lambda images, *_: list(images)
    )
    unchanged, same = scores()
    np.testing.assert_array_equal(plain, unchanged)
    assert np.abs(learned - same).max() > 0.01
