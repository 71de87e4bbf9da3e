"""Simulated rooms: seeded, furnished, seen along a smooth path that comes back."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.errors import SettingsError
from depthprint.evaluation.ground_truth import NEGATIVE, POSITIVE, loop_ground_truth
from depthprint.projection import Spherical
from depthprint.simulation.ray_casting import RayScene
from depthprint.simulation.rooms import ROOM_SPACING_M, _world_and_path, simulated_rooms


def test_same_seed_gives_the_same_bits_in_any_reading_order():
    first, second = simulated_rooms(24, seed=3), simulated_rooms(24, seed=3)
    late_first = [second[i].ranges_m for i in (23, 0, 11)]
    assert np.array_equal(first.poses, second.poses)
    for i, ranges_m in zip((23, 0, 11), late_first, strict=True):
        np.testing.assert_array_equal(first[i].ranges_m, ranges_m)


def test_other_seeds_give_other_rooms_and_paths():
    one, other = simulated_rooms(8, seed=0), simulated_rooms(8, seed=1)
    assert not np.allclose(one.poses, other.poses)
    assert len(_world_and_path(8, 0, 1)[0]) != len(_world_and_path(8, 1, 1)[0])


def test_sequence_says_what_it_is():
    rooms = simulated_rooms(12)
    assert rooms.simulated
    assert rooms.preset == "handheld"
    assert rooms.world_up == (0.0, 0.0, 1.0)
    assert (rooms.truth.kind, rooms.truth.gap) == ("overlap", 50)
    assert rooms[0].shape == (120, 160)
    assert np.degrees(rooms[0].projection.horizontal_fov_rad) == pytest.approx(58, abs=0.3)
    assert not rooms.poses.flags.writeable


@pytest.mark.parametrize("seed", range(4))
def test_camera_moves_smoothly_at_the_height_of_a_hand(seed):
    poses = simulated_rooms(200, seed=seed, n_rooms=1).poses
    positions, rotations = poses[:, :3, 3], poses[:, :3, :3]
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 2, 1), np.tile(np.eye(3), (200, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1)
    assert positions[:, 2].min() >= 1.0
    assert positions[:, 2].max() <= 1.7
    assert np.linalg.norm(np.diff(positions, axis=0), axis=1).max() < 0.15
    cosine = (np.einsum("nij,nij->n", rotations[1:], rotations[:-1]) - 1) / 2
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 10
    assert (rotations[:, 2, 1] < -0.5).all(), "the image's 'down' points down"
    assert np.ptp(positions, axis=0).min() > 0.05, "it moves in all three directions"


@pytest.mark.parametrize("seed", range(4))
def test_camera_never_enters_the_furniture(seed):
    triangles, poses = _world_and_path(60, seed, 3)
    scene = RayScene(triangles)
    around = Spherical(72, 36, elevation_min_rad=-np.pi / 2, elevation_max_rad=np.pi / 2)
    ranges_m = np.stack([scene.cast(around, pose) for pose in poses])
    assert np.isfinite(ranges_m).all(), "a room has no gaps"
    assert ranges_m.min() > 0.05


def test_returns_lie_in_the_room_and_within_the_sensors_range():
    rooms = simulated_rooms(20, seed=2, n_rooms=2)
    for i in (0, 7, 12, 19):
        image = rooms[i]
        assert 0.5 < image.valid.mean() < 1, "most pixels return, shadows do not"
        seen = image.points()[image.valid].astype(float)
        assert seen[:, 2].min() >= 0.5
        assert seen[:, 2].max() <= 8.0
        world = seen @ rooms.poses[i, :3, :3].T + rooms.poses[i, :3, 3]
        room = round(rooms.poses[i, 0, 3] / ROOM_SPACING_M)
        assert np.abs(world[:, 0] - room * ROOM_SPACING_M).max() < 4.0
        assert np.quantile(world[:, 2], 0.001) > -0.15
        assert np.quantile(world[:, 2], 0.999) < 3.1


def test_rooms_are_visited_twice():
    poses = simulated_rooms(90, n_rooms=3).poses
    assert np.round(poses[:, 0, 3] / ROOM_SPACING_M).tolist() == ([0] * 15 + [1] * 15 + [2] * 15) * 2


def test_views_come_back_and_differ_between_rooms():
    rooms = simulated_rooms(160, seed=4, n_rooms=2)
    truth = loop_ground_truth(rooms)
    assert truth.has_positive[80:].mean() > 0.3
    assert (truth.values == POSITIVE).sum() > 100
    # frames 0-39 and 80-119 are in the first room, 40-79 and 120-159 in the second
    assert (truth.values[91:120, 40] == NEGATIVE).all()
    assert (truth.values[120:, :40] == NEGATIVE).all()


@pytest.mark.parametrize(
    "wrong",
    [{"n_frames": 0}, {"n_frames": 5, "n_rooms": 3}, {"n_rooms": 0}, {"seed": -1}, {"n_frames": 20.0}],
)
def test_counts_out_of_range_are_refused(wrong):
    with pytest.raises(SettingsError, match="expected a whole number"):
        simulated_rooms(**wrong)
