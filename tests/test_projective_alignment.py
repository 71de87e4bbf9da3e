"""Alignment by projection: against a slow reference, against small_gicp, and on poses that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.verification.cloud_alignment import CloudAligner
from depthprint.verification.depth_view import DepthView, make_depth_view
from depthprint.verification.projective_alignment import ProjectiveAligner
from depthprint.verification.view_surface import surface_of
from test_verification import HAND_HELD, SPINNING, STEREO, block_world, pose_at, pose_error, seen


def pair(projection, scene, shift, yaw, height) -> tuple[DepthView, DepthView, np.ndarray]:
    """Query, match and the true T_match_query."""
    first = pose_at(projection, 0.0, 0.0, 0.3, 1.6)
    later = pose_at(projection, *shift, 0.3 + yaw, 1.6)
    match, query = (seen(scene, projection, T, height) for T in (first, later))
    return query, match, np.linalg.inv(first) @ later


@pytest.mark.parametrize("fine", [False, True])
@pytest.mark.parametrize("projection", [STEREO, SPINNING], ids=["street", "lidar"])
def test_known_motion_is_recovered_from_beside_it(projection, fine):
    query, match, true = pair(projection, block_world(3), (0.6, 0.4), 0.05, 1.6)
    found = ProjectiveAligner().refine(query, match, np.eye(4), fine=fine)
    metres, degrees = pose_error(found, true)
    assert metres < 0.06
    assert degrees < 0.4


def test_result_is_that_of_generalised_icp_on_the_whole_clouds():
    pytest.importorskip("small_gicp")
    scene = block_world(1, extent_m=4.0, size_m=1.2, blocks=120)
    query, match, true = pair(HAND_HELD, scene, (0.04, 0.05), 0.04, None)
    start = np.eye(4)
    ours = ProjectiveAligner().refine(query, match, start, fine=True)
    theirs = CloudAligner().refine(query, match, start)
    metres, degrees = pose_error(ours, theirs)
    assert metres < 0.03
    assert degrees < 0.6
    assert pose_error(ours, true)[0] < 0.03


def test_true_pose_of_views_without_noise_is_a_fixed_point():
    here = pose_at(STEREO, 0.0, 0.0, 0.3, 1.6)
    view = seen(block_world(3), STEREO, here, 1.6, 0.0)
    metres, degrees = pose_error(ProjectiveAligner().refine(view, view, np.eye(4)), np.eye(4))
    assert metres < 1e-6
    assert degrees < 1e-4


def test_window_normals_are_those_of_a_plane():
    from depthprint._kernels.projective_icp import window_normals

    camera = Pinhole(40.0, 40.0, 19.5, 14.5, 40, 30)
    normal = np.array([0.3, -0.2, -1.0]) / math.sqrt(1.13)
    directions = camera.directions()
    ranges = (-4.0 / (directions @ normal)).astype(np.float32)
    rows, columns = np.array([0, 15, 29]), np.array([0, 20, 39])
    points, normals = np.empty((3, 3)), np.empty((3, 3))
    window_normals(ranges, directions, rows, columns, 2, 0.2, False, points, normals)
    np.testing.assert_allclose(points, ranges[rows, columns, None] * directions[rows, columns], rtol=1e-6)
    assert (np.abs(normals @ normal) > 0.999).all()


def test_normals_are_not_bent_by_another_surface_behind():
    from depthprint._kernels.projective_icp import window_normals

    camera = Pinhole(40.0, 40.0, 19.5, 14.5, 40, 30)
    ranges = np.full((30, 40), 2.0, dtype=np.float32)
    ranges[:, 21:] = 6.0
    points, normals = np.empty((1, 3)), np.empty((1, 3))
    window_normals(
        ranges, camera.directions(), np.array([15]), np.array([20]), 3, 0.1, False, points, normals
    )
    np.testing.assert_allclose(np.abs(normals[0]), [0, 0, 1], atol=1e-9)


def slow_residual(points, normals, view: DepthView, pose) -> tuple[int, float]:
    """The rule of projective_residual in NumPy."""
    moved = points @ pose[:3, :3].T + pose[:3, 3]
    turned = normals @ pose[:3, :3].T
    u, v, r = view.projection.project(moved)
    limit = view.settings.max_pairing_m
    height, width = view.ranges_m.shape
    paired, total = 0, 0.0
    for k in range(len(points)):
        if not (math.isfinite(u[k]) and r[k] > 1e-6):
            continue
        row, column = math.floor(v[k] + 0.5), math.floor(u[k] + 0.5)
        if view.image.wraps:
            column %= width
        if not (0 <= row < height and 0 <= column < width):
            continue
        there = float(view.ranges_m[row, column])
        if not abs(there - r[k]) < 2 * limit:
            continue
        error = turned[k] @ (there * view.projection.directions()[row, column] - moved[k])
        if abs(error) < limit:
            paired += 1
            total += error**2
    return paired, total


@pytest.mark.parametrize("projection", [STEREO, SPINNING], ids=["street", "lidar"])
def test_residual_equals_the_slow_reference(projection):
    from depthprint._kernels.projective_icp import projective_residual

    query, match, true = pair(projection, block_world(4), (1.0, 0.5), 0.1, 1.6)
    aligner = ProjectiveAligner()
    points, normals = surface_of(query).quick
    for pose in (true, np.eye(4), pose_at(STEREO, 3.0, 0.0, 0.0, 0.0)):
        found = projective_residual(points, normals, match.image, match.settings.max_pairing_m, pose)
        expected = slow_residual(points, normals, match, pose)
        assert found[0] == expected[0]
        assert found[1] == pytest.approx(expected[1], rel=1e-9, abs=1e-9)
    inliers, rmse_m = aligner.residual(query, match, true)
    assert inliers > 500
    assert rmse_m < 0.5


def test_views_without_a_common_point_leave_the_pose_alone():
    near = make_depth_view(RangeImage(np.full((94, 155), 5.0, dtype=np.float32), STEREO))
    far = make_depth_view(RangeImage(np.full((94, 155), 7.9, dtype=np.float32), STEREO))
    found = ProjectiveAligner().refine(near, far, np.eye(4))
    np.testing.assert_allclose(found, np.eye(4), atol=1e-6)
    assert ProjectiveAligner().residual(near, far, np.eye(4)) == (0, math.inf)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_a_few_points_on_the_surface_leave_a_true_pose_where_it_is(count):
    from depthprint._kernels.projective_icp import align_by_projection

    view = seen(block_world(3), STEREO, pose_at(STEREO, 0.0, 0.0, 0.3, 1.6), 1.6, 0.0)
    points, normals = (array[:count] for array in surface_of(view).fine)
    for _ in range(50):
        pose = np.eye(4)
        align_by_projection(points, normals, view.image, 1.5, 0.75, 12, pose)
        np.testing.assert_allclose(pose, np.eye(4), atol=1e-5)
