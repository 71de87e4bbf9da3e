"""Alignment of object views: against known motions, a slow reference and another library, on simulated objects."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint._kernels.surface_alignment import BACKGROUND, OBJECT, surface_shares
from depthprint.errors import DataError
from depthprint.object_surface import SAMPLED_POINTS, object_surface
from depthprint.objects.alignment import (
    align_object_views,
    aligned_agreements,
    proposed_views,
    with_agreement,
)
from depthprint.objects.stored_geometry import LONGEST_SIDE_PX, StoredGeometry, thinned
from depthprint.partial_views import hide_part
from depthprint.projection import Pinhole, Spherical
from depthprint.range_image import RangeImage
from depthprint.simulation.meshes import box, merge
from depthprint.simulation.objects import simulated_objects
from depthprint.simulation.ray_casting import RayScene
from depthprint.turned_views import turn_of_points, turned_view

CAMERA = Pinhole(500.0, 500.0, 60.0, 50.0, 120, 100)
TABLETOP = merge([box(-0.06, 0.06, -0.04, 0.04, 0.0, 0.05), box(-0.02, 0.04, -0.02, 0.02, 0.05, 0.1)])


@pytest.fixture(scope="module")
def crops():
    objects = simulated_objects(n_categories=4, n_instances=2, frames=1, seed=6)
    return [(view, objects.read(view)) for view in objects.views]


def looking_down(elevation_deg: float, azimuth_deg: float = 0.0) -> np.ndarray:
    """Pose of a camera half a metre from a point above the table."""
    c, s = np.cos(np.radians(elevation_deg)), np.sin(np.radians(elevation_deg))
    pose = np.eye(4)
    pose[:3, :3] = np.array([[1, 0, 0], [0, -s, c], [0, -c, -s]])
    a, b = np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))
    pose[:3, :3] = np.array([[a, -b, 0], [b, a, 0], [0, 0, 1]]) @ pose[:3, :3]
    pose[:3, 3] = np.array([0, 0, 0.04]) - 0.5 * pose[:3, 2]
    return pose


def angle_deg(R: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1))))


@pytest.mark.parametrize(("elevation", "azimuth"), [(35.0, 0.0), (55.0, 0.0), (40.0, 8.0), (60.0, -6.0)])
def test_the_motion_between_two_cameras_is_found(elevation, azimuth):
    scene = RayScene(TABLETOP)
    first, second = looking_down(40.0), looking_down(elevation, azimuth)
    stored = RangeImage(scene.cast(CAMERA, first), CAMERA)
    query = RangeImage(scene.cast(CAMERA, second), CAMERA)
    found = align_object_views(query, stored)
    error = np.linalg.inv(np.linalg.inv(first) @ second) @ found.T_stored_query
    middle = object_surface(query).middle
    assert angle_deg(error[:3, :3]) < 2.0
    assert np.linalg.norm(error[:3, :3] @ middle + error[:3, 3] - middle) < 0.004
    assert found.agreement > 0.6


def test_a_view_agrees_with_itself_wholly_and_with_its_turned_copy_nearly_so(crops):
    for _, image in crops[::5]:
        itself = align_object_views(image, image)
        np.testing.assert_allclose(itself.T_stored_query, np.eye(4), atol=0.01)
        assert itself.agreement > 0.9
        turned = align_object_views(turned_view(image, 15.0, 0.0), image)
        assert 0.4 < turned.agreement < itself.agreement


def test_the_same_object_from_elsewhere_agrees_more_than_others_also_when_partly_hidden(crops):
    low = [(v, object_surface(image)) for v, image in crops if v.video == 1]
    high = [(v, image) for v, image in crops if v.video == 2]
    for share, least in ((0.0, 0.85), (0.4, 0.7)):
        right = []
        for number, (view, image) in enumerate(high):
            query = hide_part(image, share, np.random.default_rng(number)) if share else image
            agreements = aligned_agreements(object_surface(query), [surface for _, surface in low])
            right.append(low[int(agreements.argmax())][0].instance == view.instance)
        assert np.mean(right) >= least


def test_shares_are_those_of_a_slow_reference(crops):
    for (_, one), (_, other) in zip(crops[:4], crops[5:9], strict=True):
        surface, seen = object_surface(one), object_surface(other)
        pose = np.eye(4)
        pose[:3, :3] = turn_of_points(10.0, -5.0)
        pose[:3, 3] = seen.middle + 0.01
        for whole in (False, True):
            found = surface_shares(surface, seen, 3, 0.006, whole, pose)
            assert found == pytest.approx(slow_shares(surface, seen, 3, 0.006, whole, pose), abs=1e-6)
        assert found[1] > 0


def slow_shares(surface, seen, step, noise, whole, pose):
    confirmed = alike = through = 0.0
    points, normals = surface.points[::step].astype(float), surface.normals[::step].astype(float)
    fx, fy, cx, cy = seen.lens
    for point, normal in zip(points @ pose[:3, :3].T + pose[:3, 3], normals @ pose[:3, :3].T, strict=True):
        if -(normal @ point) / np.linalg.norm(point) < 0.1:
            continue
        u, v = np.floor(np.array([fx * point[0], fy * point[1]]) / point[2] + [cx + 0.5, cy + 0.5]).astype(
            int
        )
        height, width = seen.depths.shape
        if not (0 <= u < width and 0 <= v < height):
            through += whole
            continue
        around = np.s_[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
        gaps, kinds, slopes = seen.depths[around] - point[2], seen.kinds[around], seen.slopes[around]
        of_object = np.where(kinds == OBJECT, np.abs(gaps), np.inf)
        if of_object.min() < 2 * noise:
            nearest = np.unravel_index(of_object.argmin(), of_object.shape)
            share = 1 - (of_object.min() / (2 * noise)) ** 2
            alike += share
            confirmed += share * max(0.0, slopes[nearest] @ normal)
        elif seen.kinds[v, u] and (gaps[kinds > 0] >= 2 * noise).all():
            through += 1
    return np.array([confirmed, alike, through]) / len(points)


def test_another_library_finds_the_same_turn(crops):
    gicp = pytest.importorskip("small_gicp")
    image = crops[1][1]
    query = turned_view(image, 6.0, 3.0)
    found = align_object_views(query, image)
    clouds = [view.points()[view.valid & view.mask].astype(np.float64) for view in (image, query)]
    result = gicp.align(
        *clouds, found.T_stored_query, downsampling_resolution=0.003, registration_type="GICP"
    )
    difference = np.linalg.inv(result.T_target_source) @ found.T_stored_query
    assert angle_deg(difference[:3, :3]) < 3.0
    assert angle_deg(found.T_stored_query[:3, :3] @ turn_of_points(6.0, 3.0)) < 3.0


def test_the_surface_of_a_tilted_plane_has_its_normal_and_size():
    normal = np.array([0.3, -0.2, -1.0]) / np.linalg.norm([0.3, -0.2, -1.0])
    ranges_m = (-0.7 / (CAMERA.directions() @ normal)).astype(np.float32)
    mask = np.zeros(CAMERA.directions().shape[:2], dtype=bool)
    mask[20:80, 30:90] = True
    surface = object_surface(RangeImage(ranges_m, CAMERA, mask=mask))
    assert len(surface.points) == SAMPLED_POINTS
    inside = surface.normals @ normal > 0.995
    assert inside.mean() > 0.85
    # Depth is smoothed within the mask, which bends the plane a little at its edge.
    np.testing.assert_allclose((surface.points + surface.middle) @ normal, -0.7, atol=0.002)
    assert set(np.unique(surface.kinds)) == {OBJECT, BACKGROUND}
    spread = np.linalg.norm(surface.points, axis=1)
    assert surface.size == pytest.approx(np.sqrt((spread**2).mean()), rel=0.1)
    assert not surface.depths.flags.writeable


def test_what_is_no_view_of_an_object_is_refused():
    with pytest.raises(DataError, match="scan: expected a pinhole image, got Spherical"):
        object_surface(RangeImage(np.ones((4, 8)), Spherical(8, 4), source="scan"))
    with pytest.raises(DataError, match=r"mug\.png"):
        object_surface(RangeImage(np.full((100, 120), np.nan), CAMERA, source="mug.png"))
    with pytest.raises(DataError, match="scan: expected a pinhole image, got Spherical"):
        thinned(RangeImage(np.ones((4, 8)), Spherical(8, 4), source="scan"))


def test_the_likest_views_of_the_best_classes_are_proposed(monkeypatch):
    monkeypatch.setattr("depthprint.objects.alignment.CHECKED_CLASSES", 2)
    monkeypatch.setattr("depthprint.objects.alignment.CHECKED_VIEWS", 2)
    labels = np.array(["a", "b", "c"])
    of_views = np.array(["a", "b", "c", "c", "a", "c"])
    views = proposed_views(np.array([0.5, -1.0, 2.0]), labels, of_views, np.array([1, 9, 1, 3, 2, 2.0]))
    assert views.tolist() == [3, 5, 4, 0]


def test_agreement_lifts_the_class_that_it_is_with():
    labels = np.array([3, 5, 8, 9])
    scores = np.array([1.0, 1.1, 0.2, -2.0])
    plain = with_agreement(scores, labels, np.array([3, 5, 5]), np.array([0.8, 0.1, 0.2]), 0.0)
    fused = with_agreement(scores, labels, np.array([3, 5, 5]), np.array([0.8, 0.1, 0.2]), 2.0)
    assert labels[plain.argmax()] == 5
    assert labels[fused.argmax()] == 3
    added = fused - plain
    np.testing.assert_allclose(added[[0, 1]], 2.0 * np.exp([0.0, -7.2]))
    # Classes that nothing was aligned with are no better off for it.
    np.testing.assert_allclose(added[[2, 3]], added[1])


def test_kept_views_are_the_views_thinned_out(crops):
    images = [image for _, image in crops[:6]]
    kept = StoredGeometry.of(images)
    assert len(kept) == 6
    for number, image in enumerate(images):
        small, again = thinned(image), kept.image(number)
        assert max(again.shape) <= LONGEST_SIDE_PX
        np.testing.assert_array_equal(again.valid, small.valid)
        np.testing.assert_array_equal(again.mask, small.mask)
        np.testing.assert_allclose(again.ranges_m, small.ranges_m, atol=5e-5)
        assert again.projection == small.projection
        step = round(image.projection.fx / again.projection.fx)
        np.testing.assert_allclose(again.points()[1, 2], image.points()[step, 2 * step], atol=1e-4)


def test_kept_views_that_do_not_fit_together_are_refused(crops):
    kept = StoredGeometry.of([crops[0][1]])
    with pytest.raises(DataError, match="pixels"):
        StoredGeometry(kept.depths[1:], kept.objects, kept.steps_m, kept.shapes, kept.lenses)
    with pytest.raises(DataError, match="lenses"):
        StoredGeometry(kept.depths, kept.objects, kept.steps_m, kept.shapes, kept.lenses[:, :3])


def test_some_of_the_kept_views_are_the_same_views(crops):
    kept = StoredGeometry.of([image for _, image in crops[:4]])
    some = kept.taken(np.array([2, 0, 2]))
    for number, whole in enumerate((2, 0, 2)):
        np.testing.assert_array_equal(some.image(number).ranges_m, kept.image(whole).ranges_m)
        np.testing.assert_array_equal(some.surface(number).points, kept.surface(whole).points)
