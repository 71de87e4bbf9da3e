"""The coarse search for starts of an alignment, and one step of the alignment: against slow references."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.projection import LaserRow, Pinhole, Spherical
from depthprint.range_image import RangeImage
from depthprint.verification.agreement import best_starts, coarse_overlaps, mutual_agreement, view_agreement
from depthprint.verification.depth_view import DepthView, make_depth_view
from depthprint.verification.projective_alignment import ProjectiveAligner
from depthprint.verification.starts import pose_grid
from depthprint.verification.verifier import GeometricVerifier
from depthprint.verification.view_surface import surface_of
from test_verification import SPINNING, STEREO, block_world, pose_at, seen

SENSORS = {
    "street": Pinhole(20.0, 22.0, 15.0, 9.0, 31, 19),
    "lidar": Spherical(36, 9),
    "laser": LaserRow(40, -1.5, 0.07),
}


def random_view(rng, projection) -> DepthView:
    ranges = rng.uniform(1, 12, projection.directions().shape[:2]).astype(np.float32)
    ranges[rng.random(ranges.shape) < 0.2] = np.nan
    return make_depth_view(RangeImage(ranges, projection, sensor_height_m=1.0))


def slow_share(points, view: DepthView, pose) -> float:
    """Share of some points whose own pixel has their range, within twice the tolerance."""
    t = view.settings.tolerance
    height, width = view.ranges_m.shape
    moved = points.astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]
    u, v, r = view.projection.project(moved)
    confirmed = 0
    for k in range(len(points)):
        if not (math.isfinite(u[k]) and r[k] > 1e-6):
            continue
        column = math.floor(u[k] + 0.5) % width if view.image.wraps else math.floor(u[k] + 0.5)
        row = 0 if isinstance(view.projection, LaserRow) else math.floor(v[k] + 0.5)
        if 0 <= column < width and 0 <= row < height:
            allowed = 2.0 * (t[0] + t[1] * r[k] + t[2] * r[k] ** 2)
            confirmed += bool(abs(float(view.ranges_m[row, column]) - r[k]) <= allowed)
    return confirmed / len(points)


def slow_overlaps(query: DepthView, match: DepthView, poses) -> np.ndarray:
    few = query.counted[:: max(1, len(query.counted) // 32)]
    more = query.counted[:: max(1, len(query.counted) // 128)]
    overlaps = np.array([slow_share(few, match, pose) for pose in poses])
    for m in np.argsort(-overlaps, kind="stable")[: max(8, round(0.2 * len(poses)))]:
        overlaps[m] = slow_share(more, match, poses[m])
    return overlaps


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 1000), kind=st.sampled_from(sorted(SENSORS)))
def test_overlaps_of_starts_equal_the_slow_reference(seed, kind):
    rng = np.random.default_rng(seed)
    query, match = (random_view(rng, SENSORS[kind]) for _ in range(2))
    poses = pose_grid(match.settings, match.projection)[:40]
    np.testing.assert_array_equal(coarse_overlaps(query, match, poses), slow_overlaps(query, match, poses))


def test_best_starts_are_the_best_that_do_not_lie_side_by_side():
    here, later = pose_at(STEREO, 0.0, 0.0, 0.3, 1.6), pose_at(STEREO, 1.4, 0.2, 0.35, 1.6)
    match, query = (seen(block_world(3), STEREO, T, 1.6) for T in (here, later))
    grid = pose_grid(match.settings, match.projection)
    beside = grid.copy()
    beside[:, 0, 3] += 0.01
    poses = np.concatenate([grid, beside])
    starts, overlaps = best_starts(query, match, poses, 4)
    chosen: list[int] = []
    for index in np.argsort(-overlaps, kind="stable")[:32]:
        if all(np.abs(poses[index] - poses[other]).max() > 0.15 for other in chosen):
            chosen.append(int(index))
    assert starts.tolist() == chosen[:4]
    assert overlaps[starts[0]] == overlaps.max() > 0.5


def test_both_ways_of_an_agreement_are_those_of_each_way_alone():
    here, later = pose_at(STEREO, 0.0, 0.0, 0.3, 1.6), pose_at(STEREO, 0.4, 0.2, 0.35, 1.6)
    match, query = (seen(block_world(3), STEREO, T, 1.6) for T in (here, later))
    pose = np.linalg.inv(here) @ later
    there, back = mutual_agreement(query, match, pose)
    assert there == view_agreement(query.counted, match, pose, query.weights)
    other_way = view_agreement(match.counted, query, np.linalg.inv(pose), match.weights)
    assert back.likeness == pytest.approx(other_way.likeness, abs=1e-3)
    step = len(query.counted) // 400
    fewer, _ = mutual_agreement(query, match, pose, 400)
    assert step > 1
    assert fewer == view_agreement(query.counted[::step], match, pose, query.weights[::step])


def slow_step(points, normals, view: DepthView, pose, reach: float) -> np.ndarray:
    """One damped Gauss-Newton step of the alignment in NumPy, (6,): rotation vector and translation."""
    t = view.settings.tolerance
    height, width = view.ranges_m.shape
    moved, turned = points @ pose[:3, :3].T + pose[:3, 3], normals @ pose[:3, :3].T
    u, v, r = view.projection.project(moved)
    hessian, gradient = np.zeros((6, 6)), np.zeros(6)
    for k in range(len(points)):
        if not math.isfinite(u[k]):
            continue
        row, column = math.floor(v[k] + 0.5), math.floor(u[k] + 0.5)
        column = column % width if view.image.wraps else column
        if not (0 <= row < height and 0 <= column < width):
            continue
        there = float(view.ranges_m[row, column])
        sigma = t[0] + t[1] * r[k] + t[2] * r[k] ** 2
        allowed = max(reach, 2 * sigma)
        error = turned[k] @ (there * view.projection.directions()[row, column] - moved[k])
        if not (abs(there - r[k]) < 2 * allowed and abs(error) < allowed):
            continue
        slope = np.concatenate([np.cross(moved[k], turned[k]), turned[k]])
        weight = (1 - (error / allowed) ** 2) ** 2 / sigma**2
        hessian += weight * np.outer(slope, slope)
        gradient += weight * error * slope
    hessian[np.diag_indices(6)] = hessian.diagonal() * (1 + 1e-3) + 1e-6
    return np.linalg.solve(hessian, gradient)


@pytest.mark.parametrize("projection", [STEREO, SPINNING], ids=["street", "lidar"])
def test_one_step_of_the_alignment_equals_the_slow_reference(projection):
    from depthprint._kernels.projective_icp import align_by_projection

    here, later = pose_at(projection, 0.0, 0.0, 0.3, 1.6), pose_at(projection, 0.6, 0.4, 0.35, 1.6)
    match, query = (seen(block_world(4), projection, T, 1.6) for T in (here, later))
    points, normals = surface_of(query).quick
    step = slow_step(points, normals, match, np.eye(4), 1.5)
    pose = np.eye(4)
    align_by_projection(points, normals, match.image, 1.5, 0.75, 1, pose)
    np.testing.assert_allclose(pose[:3, 3], step[3:], rtol=1e-9, atol=1e-12)
    angle = math.acos((np.trace(pose[:3, :3]) - 1) / 2)
    assert angle == pytest.approx(np.linalg.norm(step[:3]), rel=1e-6)
    np.testing.assert_allclose(pose[:3, :3] @ step[:3], step[:3], rtol=1e-9, atol=1e-12)


class CountingAligner(ProjectiveAligner):
    """Counts what it is asked to align."""

    def __init__(self) -> None:
        self.quick = self.fine = 0

    def refine(self, query, match, T_match_query, *, fine=False):
        self.fine, self.quick = self.fine + fine, self.quick + (not fine)
        return super().refine(query, match, T_match_query, fine=fine)


def alignments_of_wrong_pairs(least: float) -> tuple[int, int]:
    """Quick and fine alignments of views of different places, where ``least`` agreement makes a plausible one."""
    aligner, verifier = CountingAligner(), GeometricVerifier()
    verifier._quick = aligner
    here = pose_at(STEREO, 0.0, 0.0, 0.0, 1.6)
    worlds = [seen(block_world(seed), STEREO, here, 1.6) for seed in range(8)]
    settings = replace(
        worlds[0].settings,
        coarse_overlap=0.0,
        min_overlap=0.02,
        min_overlap_seconded=0.02,
        min_agreement_seconded=least,
    )
    views = [replace(view, settings=settings) for view in worlds]
    for query, match in pairwise(views):
        assert not verifier.verify(query, match).accepted
    return aligner.quick, aligner.fine


def test_starts_that_fall_far_short_are_neither_followed_nor_refined():
    all_starts, all_refined = alignments_of_wrong_pairs(0.0)
    starts, refined = alignments_of_wrong_pairs(0.9)
    assert starts < all_starts
    assert refined < all_refined


def test_given_poses_are_refined_however_little_they_agree():
    here, later = pose_at(STEREO, 0.0, 0.0, 0.3, 1.6), pose_at(STEREO, 0.4, 0.2, 0.35, 1.6)
    match, query = (seen(block_world(3), STEREO, T, 1.6) for T in (here, later))
    strict = replace(match.settings, min_agreement_seconded=1.0, min_agreement=1.0)
    verifier = GeometricVerifier()
    aligner = verifier._quick = CountingAligner()
    found = verifier.refine(replace(query, settings=strict), replace(match, settings=strict), np.eye(4))
    assert aligner.fine == 1
    assert found.inliers > 50
