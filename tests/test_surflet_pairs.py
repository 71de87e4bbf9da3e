"""Pairs of surface points, on simulated objects: against a slow reference, and what does not change them."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from depthprint._kernels.surface_alignment import OBJECT
from depthprint._kernels.surflet_pairs import N_ALIKE, N_ANGLES, N_HALFWAY, N_LENGTHS, pair_histograms
from depthprint.baselines.kernel_descriptors.patch_grid import mirrored_image
from depthprint.encoder import load_shipped_encoder
from depthprint.errors import DataError, SettingsError
from depthprint.object_surface import object_surface
from depthprint.projection import Pinhole, Spherical
from depthprint.range_image import RangeImage
from depthprint.simulation.objects import simulated_objects
from depthprint.surflet_pairs import N_PAIR_FEATURES, pair_features, pair_vectors, pair_view

SHORTEST, LONGEST = np.array([0.005, 0.01]), np.array([0.4, 0.2])


@pytest.fixture(scope="module")
def crops():
    objects = simulated_objects(n_categories=4, n_instances=2, frames=1, seed=6)
    return [objects.read(view) for view in objects.views]


def bins(cosine: float, n: int) -> int:
    return min(int((cosine + 1) / 2 * n), n - 1)


def slow_histograms(surface) -> np.ndarray:
    """One pair after the other, as the docstring says."""
    pairs_of_bins = [(low, high) for high in range(N_ANGLES) for low in range(high + 1)]
    counts = np.zeros((len(SHORTEST), N_HALFWAY, N_LENGTHS, len(pairs_of_bins), N_ALIKE))
    points = surface.points.astype(np.float64)
    normals = surface.normals.astype(np.float64)
    fx, fy, cx, cy = surface.lens
    for i, j in combinations(range(len(points)), 2):
        line = points[j] - points[i]
        length = np.linalg.norm(line)
        if length < 1e-4:
            continue
        angles = sorted(
            (bins(normals[i] @ line / length, N_ANGLES), bins(-normals[j] @ line / length, N_ANGLES))
        )
        x, y, z = surface.middle + (points[i] + points[j]) / 2
        row, column = int(np.floor(fy * y / z + cy + 0.5)), int(np.floor(fx * x / z + cx + 0.5))
        halfway = 0
        inside = 0 <= row < surface.kinds.shape[0] and 0 <= column < surface.kinds.shape[1]
        if inside and surface.kinds[row, column] == OBJECT:
            halfway = 1 if z > surface.depths[row, column] else 2
        cell = pairs_of_bins.index(tuple(angles)), bins(normals[i] @ normals[j], N_ALIKE)
        for k, (low, high) in enumerate(zip(SHORTEST, LONGEST, strict=True)):
            centres = np.log(low) + (np.arange(N_LENGTHS) + 0.5) * np.log(high / low) / N_LENGTHS
            at = np.interp(np.log(length), centres, np.arange(N_LENGTHS))
            first = min(int(at), N_LENGTHS - 2)
            counts[k, halfway, first][cell] += 1 - (at - first)
            counts[k, halfway, first + 1][cell] += at - first
    return counts


def test_histograms_are_those_of_a_slow_count(crops):
    for image in crops[::7]:
        surface = object_surface(image)
        surface = surface._replace(points=surface.points[:60], normals=surface.normals[:60])
        found, expected = pair_histograms(surface, SHORTEST, LONGEST), slow_histograms(surface)
        # float32 in place of float64: a pair on the border of two bins may fall in the other one.
        assert np.abs(found - expected).sum() <= 0.005 * expected.sum()
        np.testing.assert_allclose(found.sum(axis=(1, 2, 3, 4)), 60 * 59 / 2, rtol=1e-9)


def test_points_that_coincide_are_no_pair(crops):
    surface = object_surface(crops[0])
    surface = surface._replace(points=np.zeros((5, 3), np.float32), normals=surface.normals[:5])
    assert pair_histograms(surface, SHORTEST, LONGEST).sum() == 0
    assert np.linalg.norm(pair_features(surface)) == 0


def test_vectors_are_units(crops):
    rows = pair_vectors(crops[:5])
    assert rows.shape == (5, N_PAIR_FEATURES)
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1.0, rtol=1e-5)


def test_a_mirror_image_has_nearly_the_same_vector_and_other_objects_have_not(crops):
    straight, mirrored = pair_vectors(crops), pair_vectors([mirrored_image(image) for image in crops])
    likeness = straight @ mirrored.T
    others = likeness[~np.eye(len(crops), dtype=bool)]
    assert np.diag(likeness).min() > 0.95
    assert np.diag(likeness).min() > np.quantile(others, 0.9)


def test_a_bigger_object_further_away_differs_by_metres_alone(crops):
    image = crops[3]
    bigger = image.replace(ranges_m=2.0 * image.ranges_m)
    metres, sizes = (np.split(row, 2) for row in (pair_vectors([image])[0], pair_vectors([bigger])[0]))
    np.testing.assert_allclose(metres[1], sizes[1], atol=0.02)
    assert np.linalg.norm(metres[0] - sizes[0]) > 0.2


def test_a_sphere_is_behind_halfway_and_a_bowl_before():
    camera = Pinhole(400.0, 400.0, 40.0, 40.0, 80, 80)
    x, y = np.meshgrid((np.arange(80) - 40) / 400, (np.arange(80) - 40) / 400)
    round_off = np.hypot(x, y) < 0.08
    for sign, halfway in ((1.0, 1), (-1.0, 2)):
        depths = 0.6 - sign * np.sqrt(np.maximum(0.06**2 - 0.36 * (x**2 + y**2), 0))
        image = RangeImage(np.where(round_off, depths, np.nan).astype(np.float32), camera)
        counts = pair_histograms(object_surface(image), SHORTEST, LONGEST)
        assert counts[0].sum(axis=(1, 2, 3))[halfway] > 0.9 * counts[0].sum()


def test_other_than_pinhole_crops_are_refused():
    with pytest.raises(DataError, match="scan: expected a pinhole image"):
        pair_vectors([RangeImage(np.ones((4, 8)), Spherical(8, 4), source="scan")])


def test_the_view_of_pairs_holds_a_column_of_each_length(crops):
    metres, sizes = pair_view(crops[0], ("metres", "sizes"))
    np.testing.assert_array_equal(pair_view(crops[0], ("sizes",))[0], sizes)
    counts = pair_vectors(crops[:1])[0].reshape(2, N_HALFWAY, N_LENGTHS, -1) ** 2
    for picture, expected in zip((metres, sizes), 2 * counts.sum(axis=(1, 3)), strict=True):
        assert picture.shape[1] == N_LENGTHS
        np.testing.assert_allclose((picture**2).sum(axis=0), expected, atol=1e-5)
        np.testing.assert_allclose((picture**2).sum(), 1.0, rtol=1e-5)
    with pytest.raises(SettingsError, match="'inches'"):
        pair_view(crops[0], ("inches",))


def test_codes_of_pairs_stay_as_they_are_in_the_mirror(crops):
    encoder = load_shipped_encoder("object")
    encoding = encoder.describe(crops[0])
    lengths = []
    for number, stream in enumerate(encoder.settings.streams):
        same = np.array_equal(encoding.vectors[number], encoding.mirrored.vectors[number])
        assert same == (stream.view == "pairs")
        if same:
            lengths.append(encoding.signatures[number].points[:, -1] / stream.position_weight)
    assert len(lengths) == 2
    assert all(np.all((at > 0) & (at < 1) & (np.diff(at, prepend=0) > 0)) for at in lengths)
