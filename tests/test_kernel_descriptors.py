"""Kernel descriptors against their definitions, written out sum by sum."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from depthprint.baselines.kernel_descriptors.gradient import (
    depth_gradient,
    gradient_descriptors,
    gradient_kernel,
)
from depthprint.baselines.kernel_descriptors.kinds import KINDS, describe_crops
from depthprint.baselines.kernel_descriptors.lbp import binary_patterns, lbp_descriptors, lbp_kernel
from depthprint.baselines.kernel_descriptors.match_kernel import (
    gaussian_kernel,
    grid_basis,
    kpca_directions,
)
from depthprint.baselines.kernel_descriptors.patch_grid import depth_and_points, mirrored_image, patch_corners
from depthprint.baselines.kernel_descriptors.size import N_NODES, NODE_STEP_M, size_descriptors, size_kernel
from depthprint.baselines.kernel_descriptors.spin import spin_descriptors, spin_kernel, surface_normals
from depthprint.errors import DataError, SettingsError
from depthprint.projection import LaserRow, Pinhole
from depthprint.range_image import RangeImage


def crop(height=44, width=53, focal_px=120.0, seed=0):
    """A bumpy surface about 1 m away with a step and a few holes."""
    generator = np.random.default_rng(seed)
    rows, columns = np.mgrid[:height, :width]
    depth_m = (
        1.0 + 0.03 * np.sin(rows / 5) + 0.02 * np.cos(columns / 7) + 0.002 * generator.random((height, width))
    )
    depth_m[:, width // 2 :] += 0.08
    depth_m[generator.random((height, width)) < 0.03] = np.nan
    camera = Pinhole(focal_px, focal_px, 17.0, 25.0, width, height)
    mask = np.zeros((height, width), dtype=bool)
    mask[15:-15, 18:-18] = True
    return RangeImage(depth_m, camera, mask=mask, source="bumpy crop")


def direct_project(kernel, attributes, positions, weights):
    """E^T v, v the weighted sum over points of the kernels against every pair of basis points."""
    v = np.zeros((len(kernel.attribute), len(kernel.spatial)))
    for attribute, position, weight in zip(attributes, positions, weights, strict=True):
        near = np.exp(-kernel.attribute_gamma * ((attribute - kernel.attribute) ** 2).sum(1))
        here = np.exp(-kernel.spatial_gamma * ((position - kernel.spatial) ** 2).sum(1))
        v += weight * np.outer(near, here)
    return np.einsum("as,ask->k", v, kernel.directions.astype(np.float64))


def patch_pixels(top, left, size=16):
    return [(top + r, left + c) for r, c in itertools.product(range(size), range(size))]


def patch_positions(size=16):
    return [np.array([r, c]) / size for r, c in itertools.product(range(size), range(size))]


@pytest.mark.parametrize(
    ("attribute", "gammas", "dims"),
    [
        (grid_basis(np.linspace(-1, 1, 4), np.linspace(-1, 1, 4)), (5.0, 3.0), 20),
        (grid_basis(*[np.array([0.0, 1.0])] * 4), (3.0, 3.0), 9),
        (np.linspace(0, 1, 30)[:, None], (30.0, 300.0), 12),
    ],
)
def test_kernel_components_are_those_of_the_whole_centred_matrix(attribute, gammas, dims):
    spatial = grid_basis(np.linspace(0, 1, 3), np.linspace(0, 1, 2))
    first, second = (gaussian_kernel(b, b, g) for b, g in zip((attribute, spatial), gammas, strict=True))
    whole = np.kron(first, second)
    centring = np.eye(len(whole)) - 1.0 / len(whole)
    centred = centring @ whole @ centring
    values, vectors = np.linalg.eigh(centred)
    while (
        values[-dims] - values[-dims - 1] < 1e-9
    ):  # equal eigenvalues: which directions are cut is anybody's
        dims += 1
    found = kpca_directions(first, second, dims).reshape(len(whole), dims)
    np.testing.assert_allclose(found.T @ found, np.eye(dims), atol=1e-9)
    np.testing.assert_allclose(centred @ found, found * values[::-1][:dims], atol=1e-9)
    projector = vectors[:, -dims:] @ vectors[:, -dims:].T
    np.testing.assert_allclose(found @ found.T, projector, atol=1e-6)


@pytest.mark.parametrize(
    ("attribute", "dims"),
    [
        (grid_basis(*[np.array([0.0, 1.0])] * 4), 40),
        (grid_basis(np.linspace(-1, 1, 6), np.linspace(-1, 1, 6)), 60),
    ],
)
def test_rounding_does_not_turn_the_components_of_a_symmetric_basis(attribute, dims):
    spatial = grid_basis(np.linspace(0, 1, 3), np.linspace(0, 1, 3))
    first, second = (gaussian_kernel(b, b, 3.0) for b in (attribute, spatial))
    noise = np.random.default_rng(8).normal(0.0, 1e-15, first.shape)
    expected = kpca_directions(first, second, dims)
    np.testing.assert_allclose(kpca_directions(first + noise + noise.T, second, dims), expected, atol=1e-6)


def test_as_many_components_as_asked_for_or_an_error():
    kernel = gaussian_kernel(np.eye(3), np.eye(3), 1.0)
    with pytest.raises(SettingsError, match="1 to 8 dimensions, got 9"):
        kpca_directions(kernel, kernel, 9)


@pytest.mark.parametrize(
    ("kernel", "basis", "dims"),
    [(gradient_kernel, 2500, 200), (lbp_kernel, 6400, 200), (spin_kernel, 2500, 200), (size_kernel, 100, 50)],
)
def test_bases_are_as_large_as_published(kernel, basis, dims):
    directions = kernel().directions
    assert directions.shape[0] * directions.shape[1] == basis
    assert directions.shape[2] == dims


def test_gradient_descriptor_is_the_weighted_sum_over_its_pixels():
    image = crop()
    described = gradient_descriptors(image)
    gx, gy, magnitude = depth_gradient(depth_and_points(image, 16)[0])
    rows, columns = patch_corners(image.shape, 16)
    for number, (top, left) in list(enumerate(itertools.product(rows, columns)))[::7]:
        pixels = patch_pixels(top, left)
        weights = np.array([magnitude[p] for p in pixels], dtype=np.float64)
        weights /= max(np.linalg.norm(weights), 0.8)
        expected = direct_project(
            gradient_kernel(), [np.array([gx[p], gy[p]]) for p in pixels], patch_positions(), weights
        )
        np.testing.assert_allclose(described.vectors[number], expected, atol=2e-4)
        np.testing.assert_allclose(described.positions[number], [(left + 8) / 53, (top + 8) / 44], rtol=1e-6)


def test_gradient_of_a_slope_is_its_slope():
    columns = np.broadcast_to(np.arange(20, dtype=np.float32), (20, 20))
    gx, gy, magnitude = (side[6:-6, 6:-6] for side in depth_gradient(1 + 0.01 * columns))
    # Correlated, not convolved: the orientation points to where the surface comes nearer.
    np.testing.assert_allclose(gx, -1.0, atol=1e-4)
    np.testing.assert_allclose(gy, 0.0, atol=1e-3)
    assert np.ptp(magnitude) < 1e-5
    assert 0.01 < magnitude[0, 0] < 0.05


def test_patterns_say_which_neighbours_lie_at_least_as_far():
    depth = np.array([[1, 2, 3], [4, 2, 2], [1, 1, 9]], dtype=np.float32)
    numbers, deviation = binary_patterns(depth)
    assert numbers[1, 1] == int("01111001", 2)
    assert numbers[0, 0] == int("00001011", 2), "outside the crop depth is zero"
    assert deviation[1, 1] == pytest.approx(np.std(depth, ddof=1))


def test_lbp_descriptor_is_the_weighted_sum_over_its_pixels():
    image = crop(seed=1)
    described = lbp_descriptors(image)
    numbers, deviation = binary_patterns(depth_and_points(image, 16)[0])
    rows, columns = patch_corners(image.shape, 16)
    for number, (top, left) in list(enumerate(itertools.product(rows, columns)))[::9]:
        pixels = patch_pixels(top, left)
        weights = np.array([deviation[p] for p in pixels], dtype=np.float64)
        weights /= max(np.linalg.norm(weights), 0.8)
        bits = [np.array([int(b) for b in f"{numbers[p]:08b}"]) for p in pixels]
        expected = direct_project(lbp_kernel(), bits, patch_positions(), weights)
        np.testing.assert_allclose(described.vectors[number], expected, atol=2e-4)


def direct_normal(points, row, column):
    near = [
        points[r, c]
        for r in range(max(0, row - 5), min(points.shape[0], row + 6))
        for c in range(max(0, column - 5), min(points.shape[1], column + 6))
        if points[r, c, 2] > 0
        and abs(points[r, c, 2] - points[row, column, 2]) < 0.01 * points[row, column, 2]
    ]
    if len(near) <= 3:
        return np.zeros(3)
    normal = np.linalg.eigh(np.cov(np.array(near).T))[1][:, 0]
    return normal * np.sign(normal @ points[row, column])


def test_normals_are_the_least_principal_components_of_their_windows():
    _, points = depth_and_points(crop(20, 24), 16)
    normals = surface_normals(points)
    for row, column in itertools.product(range(0, 20, 3), range(0, 24, 4)):
        if points[row, column, 2] > 0:
            np.testing.assert_allclose(normals[row, column], direct_normal(points, row, column), atol=1e-6)
        else:
            assert not normals[row, column].any()


def test_spin_descriptor_is_the_mean_over_the_points_around():
    image = crop(48, 60)
    described = spin_descriptors(image)
    _, points = depth_and_points(image, 40)
    normals = surface_normals(points)
    rows, columns = patch_corners(image.shape, 40)
    compared = 0
    for top, left in itertools.product(rows, columns):
        centre, axis = points[top + 20, left + 20], normals[top + 20, left + 20]
        attributes, places = [], []
        for pixel in patch_pixels(top, left, 40):
            offset = points[pixel] - centre
            if points[pixel][2] == 0 or not normals[pixel].any() or np.linalg.norm(offset) >= 0.05:
                continue
            angle = np.arccos(np.clip(axis @ normals[pixel], -1, 1))
            along = axis @ offset
            attributes.append(np.array([np.sin(angle), np.cos(angle)]))
            places.append(np.array([along, np.sqrt(max(offset @ offset - along**2, 0))]))
        if centre[2] == 0 or not axis.any() or len(places) <= 10:
            continue
        assert len(places) <= 256
        expected = direct_project(spin_kernel(), attributes, places, np.full(len(places), 1 / len(places)))
        np.testing.assert_allclose(described.vectors[compared], expected, atol=2e-4)
        compared += 1
    assert compared == len(described.vectors) > 2


def test_of_many_points_around_a_fixed_choice_counts():
    image = crop(48, 60, focal_px=570.0)
    first, second = spin_descriptors(image), spin_descriptors(image)
    assert len(first.vectors) > 2
    np.testing.assert_array_equal(first.vectors, second.vectors)


def test_size_descriptor_is_the_mean_over_distances_to_all_points():
    image = crop(40, 39)
    described = size_descriptors(image)
    depth, points = depth_and_points(image, 40)
    cloud = points[depth > 0]
    assert 1500 < len(cloud) <= 1600
    rows, columns = patch_corners(depth.shape, 40)
    centre = points[rows[0] + 20, columns[0] + 20]
    distances = np.linalg.norm(cloud - centre, axis=1)[:, None]
    expected = direct_project(
        size_kernel(), distances, np.zeros((len(cloud), 1)), np.full(len(cloud), 1 / len(cloud))
    )
    assert described.vectors.shape == (1, 50)
    np.testing.assert_allclose(described.vectors[0], expected, atol=1e-5)


def test_cubics_between_nodes_give_the_kernel_of_a_distance():
    from depthprint._kernels.point_kernels import mean_distance_shares

    cloud = np.random.default_rng(2).uniform(-0.6, 0.6, (300, 3))
    shares = mean_distance_shares(np.zeros((1, 3)), cloud, NODE_STEP_M, N_NODES)
    nodes = NODE_STEP_M * (np.arange(N_NODES) - 1)
    for basis in (0.0, 0.4, 1.0):
        expected = np.exp(-30.0 * (np.linalg.norm(cloud, axis=1) - basis) ** 2).mean()
        assert shares[0] @ np.exp(-30.0 * (nodes - basis) ** 2) == pytest.approx(expected, abs=1e-7)


def test_far_points_add_nothing_to_the_size_and_do_not_overflow():
    from depthprint._kernels.point_kernels import mean_distance_shares

    centres = np.array([[0.0, 0.0, 1.0]])
    near = mean_distance_shares(centres, np.array([[0.0, 0.0, 1.3]]), NODE_STEP_M, N_NODES)
    both = mean_distance_shares(centres, np.array([[0.0, 0.0, 1.3], [0.0, 0.0, 4e9]]), NODE_STEP_M, N_NODES)
    np.testing.assert_array_equal(both, near / 2)


@pytest.mark.parametrize("kind", KINDS)
def test_a_crop_smaller_than_a_patch_still_has_a_place(kind):
    described = describe_crops([crop(13, 12, focal_px=60.0)], kind)[0]
    assert np.isfinite(described.vectors).all()
    assert len(described.vectors) == 1
    np.testing.assert_allclose(described.positions, 0.5, atol=0.05)


@pytest.mark.parametrize("kind", KINDS)
def test_masked_descriptors_do_not_see_the_surroundings(kind):
    image = crop()
    moved = image.replace(ranges_m=np.where(image.mask, image.ranges_m, 3.0))
    masked = [describe_crops([im], kind, masked=True)[0].vectors for im in (image, moved)]
    whole = [describe_crops([im], kind)[0].vectors for im in (image, moved)]
    np.testing.assert_array_equal(*masked)
    assert whole[0].shape != whole[1].shape or not np.allclose(*whole)


def test_a_mirrored_crop_holds_the_mirrored_points():
    image = crop()
    points = mirrored_image(image).points()[:, ::-1]
    np.testing.assert_allclose(points * [-1, 1, 1], image.points(), atol=1e-6)
    np.testing.assert_array_equal(mirrored_image(mirrored_image(image)).ranges_m, image.ranges_m)


@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if kind.mirror_free])
def test_a_mirror_leaves_distances_and_angles_as_they_are(kind):
    image = crop(57, 73)  # so many pixels that the mirrored grid is the grid
    described, mirrored = describe_crops([image, mirrored_image(image)], kind)
    turned = described.mirrored()
    assert len(mirrored.vectors) > 10
    order, expected = (np.lexsort(np.round(d.positions, 4).T) for d in (mirrored, turned))
    np.testing.assert_allclose(mirrored.positions[order], turned.positions[expected], atol=1 / 57 + 1e-6)
    near = np.abs(mirrored.vectors[order] - turned.vectors[expected]).max(1)
    assert np.median(near) < 0.02 * np.abs(turned.vectors).max()


def test_other_cameras_and_unknown_kinds_are_refused():
    scan = RangeImage(np.ones((1, 9)), LaserRow(9, -1.0, 0.1), source="scan 7")
    with pytest.raises(DataError, match="scan 7: expected a pinhole image, got LaserRow"):
        describe_crops([scan], "spin")
    with pytest.raises(DataError, match="scan 7"):
        mirrored_image(scan)
    with pytest.raises(SettingsError, match="gradient, lbp, spin, size, got 'colour'"):
        describe_crops([crop()], "colour")
