"""The simulated street's parts: routes, the town, parked and moving cars, ray casting, sensors' noise, drives."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.errors import DataError, SettingsError
from depthprint.projection import LaserRow, Pinhole, Spherical
from depthprint.simulation.drive import SENSORS, Drive, SensorModel
from depthprint.simulation.meshes import box, merge, moved
from depthprint.simulation.parking import ParkingSlots, parked_car, parked_cars, visit_switches
from depthprint.simulation.ray_casting import RayScene, nearest_surface
from depthprint.simulation.route import Route, built_in_route, route_from_kitti_poses
from depthprint.simulation.sensor_noise import kinect_noise, lidar_noise, stereo_noise
from depthprint.simulation.traffic import Traffic
from depthprint.simulation.world import build_street_world

CAMERA = Pinhole(fx=100.0, fy=100.0, cx=39.5, cy=29.5, width=80, height=60)


def two_rounds(step_m: float = 3.0) -> Route:
    """A square with round corners, driven twice over exactly the same poses."""
    angles = np.radians(np.linspace(-90, 270, 160, endpoint=False))
    corners = 33.0 * np.sign(np.stack([np.cos(angles + 1e-6), np.sin(angles + 1e-6)], axis=1))
    line = corners + 12.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    line = np.concatenate([line, line[:1]])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.arange(0.0, arc[-1] - step_m / 2, step_m)
    positions = np.stack([np.interp(at, arc, line[:, k]) for k in range(2)], axis=1)
    step = np.roll(positions, -1, axis=0) - np.roll(positions, 1, axis=0)
    return Route(np.tile(positions, (2, 1)), np.tile(np.arctan2(step[:, 1], step[:, 0]), 2))


def alignment(ahead, positions):
    """Cosine between where each inner frame looks and the way from the frame before it to the one after it."""
    way = positions[2:] - positions[:-2]
    return (ahead[1:-1] * way).sum(1) / np.linalg.norm(way, axis=1)


def exact(projection, height_m=1.5) -> SensorModel:
    """A sensor without noise."""
    return SensorModel(projection, height_m, lambda ranges, rng: ranges)


@pytest.fixture(scope="module")
def world():
    return build_street_world(built_in_route(300.0, 1), 1)


@pytest.fixture(scope="module")
def round_world():
    return build_street_world(two_rounds(), 3)


# Routes


@pytest.mark.parametrize("length_m", [300.0, 1234.0])
def test_the_built_in_route_is_as_long_as_asked_in_even_steps_and_heads_along_its_motion(length_m):
    route = built_in_route(length_m, 2)
    assert route.arc_m[-1] == pytest.approx(length_m, rel=0.01)
    steps = np.diff(route.positions_m, axis=0)
    assert np.hypot(*steps.T).max() <= 0.8 + 1e-6
    ahead = np.stack([np.cos(route.headings_rad), np.sin(route.headings_rad)], axis=1)
    assert alignment(ahead, route.positions_m).min() > math.cos(math.radians(1))


def test_the_built_in_route_comes_back_in_both_directions():
    route = built_in_route(600.0, 0)
    late = np.arange(len(route)) - np.arange(len(route))[:, None] > 100
    near = late & (np.hypot(*(route.positions_m[:, None] - route.positions_m).transpose(2, 0, 1)) < 5)
    same_way = np.cos(route.headings_rad[:, None] - route.headings_rad)
    assert (near & (same_way > 0.9)).any(1).sum() > 50
    assert (near & (same_way < -0.9)).any(1).sum() > 50


def test_another_seed_is_another_route_and_the_same_seed_the_same():
    first, again, other = built_in_route(300.0, 4), built_in_route(300.0, 4), built_in_route(300.0, 5)
    assert np.array_equal(first.positions_m, again.positions_m)
    n = min(len(first), len(other))
    assert np.abs(first.positions_m[:n] - other.positions_m[:n]).max() > 1


@pytest.mark.parametrize("length_m", [299.0, 0.0, -5.0, math.nan, math.inf])
def test_a_route_too_short_or_endless_is_refused(length_m):
    with pytest.raises(SettingsError, match="length_m"):
        built_in_route(length_m)


@pytest.mark.parametrize("seed", [-1, 1.5, 2.0, True, "a", None, math.nan])
def test_a_seed_that_is_no_integer_of_at_least_zero_is_refused(seed, world):
    with pytest.raises(SettingsError, match="seed"):
        built_in_route(300.0, seed)
    with pytest.raises(SettingsError, match="seed"):
        build_street_world(world.route, seed)


@pytest.mark.parametrize(
    ("positions", "headings", "word"),
    [
        (np.zeros((3, 3)), np.zeros(3), "expected positions"),
        (np.zeros((3, 2)), np.zeros(2), "expected positions"),
        (np.zeros((1, 2)), np.zeros(1), "two frames"),
        (np.full((3, 2), np.nan), np.zeros(3), "finite"),
    ],
)
def test_a_route_of_wrong_arrays_is_refused(positions, headings, word):
    with pytest.raises(DataError, match=word):
        Route(positions, headings)


def test_a_route_is_read_only():
    with pytest.raises(ValueError, match="read-only"):
        built_in_route(300.0).positions_m[0] = 0.0


def kitti_row(yaw_rad: float, x: float, z: float, y: float = 0.0) -> list[float]:
    """One row of a KITTI file: a camera that looks along +z, turned to the right by ``yaw_rad``."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return [c, 0, s, x, 0, 1, 0, y, -s, 0, c, z]


def test_kitti_poses_become_a_level_route_with_z_up(tmp_path):
    # Ahead for 2 m, then a right turn and 3 m to the right, while the recorded height drifts.
    rows = [kitti_row(0, 0, 0), kitti_row(0, 0, 2, y=-7), kitti_row(math.pi / 2, 3, 2, y=9)]
    path = tmp_path / "00.txt"
    np.savetxt(path, rows)
    route = route_from_kitti_poses(path)
    assert np.allclose(route.positions_m, [(0, 0), (2, 0), (2, -3)])
    assert np.allclose(route.headings_rad, [0, 0, -math.pi / 2])


UP = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0]


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "empty"),
        ("# nothing\n", "at least one pose"),
        ("1 2 3\n4 5 6\n", "12"),
        ("a b c\n", "numbers"),
        (" ".join(map(str, kitti_row(0, 0, 0))) + "\n", "at least two poses"),
        ("\n".join(" ".join(map(str, row)) for row in [kitti_row(0, 0, 0), UP]), "pose 2 looks up or down"),
        ("\n".join(" ".join(map(str, row)) for row in [kitti_row(0, 0, 0), [math.nan] * 12]), "line 2"),
    ],
)
def test_a_wrong_pose_file_is_an_error_that_names_it(text, word, tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(DataError, match=rf"poses\.txt.*{word}"):
        route_from_kitti_poses(path)


def test_a_missing_pose_file_is_an_error_that_names_it(tmp_path):
    with pytest.raises(DataError, match=r"absent\.txt"):
        route_from_kitti_poses(tmp_path / "absent.txt")


def test_a_real_kitti_path_is_as_long_as_it_was_driven(data_root):
    route = route_from_kitti_poses(data_root / "kitti_odometry" / "poses" / "07.txt")
    steps = np.diff(route.positions_m, axis=0)
    moving = np.hypot(*steps.T) > 0.2
    ahead = np.stack([np.cos(route.headings_rad), np.sin(route.headings_rad)], axis=1)[:-1]
    along = (ahead * steps).sum(1)[moving] / np.hypot(*steps[moving].T)
    assert np.median(along) > 0.99
    assert 600 < route.arc_m[-1] < 800


# The town


def test_the_same_seed_builds_the_same_town_and_another_seed_another(world):
    again, other = build_street_world(world.route, 1), build_street_world(world.route, 2)
    assert np.array_equal(world.triangles, again.triangles)
    assert np.array_equal(world.slots.positions_m, again.slots.positions_m)
    assert world.kinds == again.kinds
    assert world.triangles.shape != other.triangles.shape or not np.allclose(world.triangles, other.triangles)


def distances_to_path(world, below_m: float) -> np.ndarray:
    """Least horizontal distance of each near thing's triangles that begin below a height to any frame's position."""
    lane, found = world.route.positions_m, []
    for thing, (centre, radius) in enumerate(zip(world.centres_m, world.radii_m, strict=True)):
        near = lane[np.hypot(*(lane - centre).T) < radius + 4.0]
        triangles = world.triangles[world.first_triangle[thing] : world.first_triangle[thing + 1]]
        low = triangles[triangles[..., 2].min(1) < below_m][..., :2].astype(float)
        for k in range(3) if len(near) and len(low) else ():
            found.append(segment_distance(near, low[:, k], low[:, (k + 1) % 3]).min())
    return np.array(found)


def segment_distance(points, start, end):
    along = end - start
    offset = points[:, None] - start
    share = np.clip((offset * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12), 0, 1)
    return np.linalg.norm(offset - share[..., None] * along, axis=-1)


@pytest.mark.parametrize("seed", [0, 6, 32, 36, 39])
def test_nothing_stands_within_one_and_a_half_metres_of_the_path_even_where_it_meets_itself(seed):
    town = build_street_world(built_in_route(300.0, seed), seed)
    distances = distances_to_path(town, below_m=2.2)
    assert len(distances) > 20
    assert distances.min() >= 1.5
    for slot, (x, y) in enumerate(town.slots.positions_m):
        gap = np.hypot(*(town.route.positions_m - (x, y)).T).min()
        cars = parked_cars(0, replace_occupancy(town.slots), np.array([slot]), np.array([0]), 0.0)
        reach = cars[..., :2].reshape(-1, 2).astype(float)
        nearest = np.hypot(*(town.route.positions_m[:, None] - reach).transpose(2, 0, 1)).min()
        assert gap > nearest >= 1.5


def replace_occupancy(slots: ParkingSlots) -> ParkingSlots:
    return replace(slots, occupancy=np.ones(len(slots)))


def test_a_street_driven_twice_is_lined_once(round_world):
    once = Route(*(a[: len(a) // 2] for a in (round_world.route.positions_m, round_world.route.headings_rad)))
    assert distances_to_path(round_world, below_m=2.2).min() >= 1.5
    assert round_world.line.novel.mean() < 0.75
    assert build_street_world(once, 3).line.novel.mean() > 0.8


def test_every_thing_lies_within_its_circle_and_only_bushes_reach_below_the_ground(world):
    for thing, (centre, radius) in enumerate(zip(world.centres_m, world.radii_m, strict=True)):
        corners = world.triangles[world.first_triangle[thing] : world.first_triangle[thing + 1]].reshape(
            -1, 3
        )
        assert np.hypot(*(corners[:, :2] - centre).T).max() <= radius + 1e-3
        assert corners[:, 2].max() > 0.5
        assert corners[:, 2].min() >= -1e-3 or world.kinds[thing] == "bush"


def test_things_far_away_are_left_out_but_the_ground_stays(world):
    everything = world.within(world.route.positions_m, 400.0)
    nothing = world.within(np.array([[1e5, 1e5]]), 50.0)
    assert len(everything) == len(world.triangles) + 2
    assert len(nothing) == 2
    assert np.ptp(nothing[..., 2]) == 0


def test_slots_are_free_of_what_stands(world):
    from depthprint.simulation.footprints import Footprint

    x, y = world.slots.positions_m[0]
    assert not world.is_free(Footprint(x, y, 0.0, 0.5, 0.5), 0.0)
    assert world.is_free(Footprint(x + 1e4, y, 0.0, 0.5, 0.5), 0.0)


# Parked cars


def row_of_slots(count: int, occupancy: float = 1.0) -> ParkingSlots:
    return ParkingSlots(
        np.stack([np.arange(count) * 6.0, np.zeros(count)], 1), np.zeros(count), np.full(count, occupancy)
    )


@pytest.mark.parametrize("share", [0.0, 0.2, 0.7, 1.0])
def test_the_share_of_slots_with_another_car_is_the_share_asked_for(share):
    changed = [
        parked_car(9, slot, 1, 1.0, share) != parked_car(9, slot, 0, 1.0, share) for slot in range(3000)
    ]
    assert np.mean(changed) == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / 3000))


def test_a_larger_share_only_adds_changes():
    def changed(share):
        return {s for s in range(400) if parked_car(2, s, 1, 1.0, share) != parked_car(2, s, 0, 1.0, share)}

    assert changed(0.1) < changed(0.4) < changed(0.9)


def test_cars_stay_through_all_visits_when_none_is_redrawn_and_never_when_all_are():
    for slot in range(50):
        assert len({parked_car(0, slot, visit, 1.0, 0.0) for visit in range(6)}) == 1
        assert len({parked_car(0, slot, visit, 1.0, 1.0) for visit in range(6)}) == 6


def test_slots_are_taken_as_often_as_their_occupancy_says():
    taken = [parked_car(5, slot, 0, 0.35, 0.0) is not None for slot in range(3000)]
    assert np.mean(taken) == pytest.approx(0.35, abs=0.04)
    assert parked_car(5, 0, 0, 0.0, 0.0) is None


def test_parked_cars_stand_on_the_ground_within_their_slots():
    slots = row_of_slots(40)
    for slot in range(40):
        corners = parked_cars(1, slots, np.array([slot]), np.array([0]), 0.2).reshape(-1, 3)
        assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-6)
        assert np.abs(corners[:, 0] - 6.0 * slot).max() < 3.4
        assert np.abs(corners[:, 1]).max() < 1.4
        assert 1.3 < corners[:, 2].max() < 2.5


def test_no_slots_give_no_cars():
    none = np.zeros(0, dtype=np.int64)
    assert parked_cars(0, row_of_slots(3, 0.0), np.arange(3), np.zeros(3, np.int64), 0.5).shape == (0, 3, 3)
    assert parked_cars(0, row_of_slots(0), none, none, 0.5).shape == (0, 3, 3)
    assert visit_switches(row_of_slots(0), two_rounds()) == ()


def test_a_slot_is_visited_anew_after_a_drive_elsewhere_and_not_before():
    route = two_rounds()
    x, y = route.positions_m[20]
    far = ParkingSlots(np.array([[x, y]]), np.zeros(1), np.ones(1))
    (switches,) = visit_switches(far, route)
    lap = route.arc_m[len(route) // 2]
    assert len(switches) == 1
    assert switches[0] == pytest.approx(route.arc_m[20] + lap / 2, abs=10)


# Moving cars


def straight(length_m: float = 1500.0) -> Route:
    along = np.arange(0.0, length_m, 1.0)
    return Route(np.stack([along, np.zeros_like(along)], axis=1), np.zeros(len(along)))


def test_moving_cars_keep_to_their_lanes_and_off_the_vehicle():
    route = straight()
    traffic, leading, oncoming = Traffic(route, 3), 0, 0
    for frame in range(0, len(route), 5):
        for car in traffic.at(frame).reshape(-1, 6 * 12 + 12, 3, 3) if len(traffic.at(frame)) else ():
            x, y = car[..., 0].mean() - frame, car[..., 1].mean()
            if abs(y) < 0.5:
                leading += 1
                assert 5 < x < 35
            else:
                oncoming += 1
                assert y == pytest.approx(2.9, abs=0.3)
                assert car[..., 1].min() > 1.5
    assert leading > 0
    assert oncoming > 0


def test_traffic_is_the_same_for_the_same_seed_only():
    route = straight()
    frames = range(0, len(route), 25)
    first, again, other = (b"".join(Traffic(route, s).at(f).tobytes() for f in frames) for s in (1, 1, 2))
    assert first == again
    assert first != other


# Ray casting


def at(x=0.0, y=0.0, z=0.0, rotation=None):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    if rotation is not None:
        pose[:3, :3] = rotation
    return pose


WALL = box(7.0, 8.0, -50, 50, -50, 50)


def test_a_camera_measures_depth_along_its_axis():
    depth = RayScene(WALL).cast(CAMERA, at(rotation=CAMERA.R_flu_sensor))
    assert depth.dtype == np.float32
    assert np.allclose(depth, 7.0, atol=1e-4)


def test_a_spinning_scanner_measures_euclidean_range():
    lidar = Spherical(90, 20, -math.pi / 4, math.pi / 4, -0.3, 0.3)
    ranges = RayScene(WALL).cast(lidar, at())
    assert np.allclose(ranges * lidar.directions()[..., 0], 7.0, atol=1e-4)


def test_a_planar_scanner_measures_euclidean_range_from_right_to_left():
    row = LaserRow(181, -math.pi / 2, math.pi / 180)
    scene = RayScene(merge([WALL, box(-1, 1, -4, -3, -1, 1)]))
    ranges = scene.cast(row, at())
    assert ranges.shape == (1, 181)
    assert ranges[0, 90] == pytest.approx(7.0, abs=1e-4)
    assert ranges[0, 135] == pytest.approx(7.0 * math.sqrt(2), abs=1e-3)
    assert ranges[0, 0] == pytest.approx(3.0, abs=1e-4)
    assert np.isnan(ranges[0, 180])


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.0, math.pi])
def test_moving_the_sensor_and_the_world_together_changes_nothing(heading):
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([(c, -s, 0), (s, c, 0), (0, 0, 1.0)])
    scene = RayScene(moved(box(4, 6, -1, 2, 0, 3), 10.0, -20.0, heading))
    depth = scene.cast(CAMERA, at(10.0, -20.0, 1.5, turn @ CAMERA.R_flu_sensor))
    rest = RayScene(box(4, 6, -1, 2, 0, 3)).cast(CAMERA, at(0, 0, 1.5, CAMERA.R_flu_sensor))
    assert (np.isnan(depth) == np.isnan(rest)).mean() > 0.99
    assert np.nanmax(np.abs(depth - rest)) < 1e-3


def test_the_image_is_neither_mirrored_nor_upside_down():
    scene = RayScene(merge([box(5, 6, 1, 2, -1, 1), box(9, 10, -2, -1, 0.5, 1)]))
    depth = scene.cast(CAMERA, at(rotation=CAMERA.R_flu_sensor))
    left, right = depth[:, :40], depth[:, 40:]
    assert np.nanmedian(left) == pytest.approx(5.0, abs=1e-3)
    assert np.nanmedian(right) == pytest.approx(9.0, abs=1e-3)
    assert np.isfinite(right[:30]).any()
    assert not np.isfinite(right[30:]).any()


def test_an_empty_scene_returns_nothing_and_the_nearest_of_casts_wins():
    empty = RayScene(np.zeros((0, 3, 3), np.float32)).cast(CAMERA, at(rotation=CAMERA.R_flu_sensor))
    wall = RayScene(WALL).cast(CAMERA, at(rotation=CAMERA.R_flu_sensor))
    assert np.isnan(empty).all()
    assert np.array_equal(nearest_surface(empty, wall), wall)
    assert np.array_equal(nearest_surface(wall, wall - 1, empty), wall - 1)


# Noise


FULL_KITTI = Pinhole(fx=718.856, fy=718.856, cx=607.2, cy=185.2, width=1241, height=60)
KINECT = Pinhole(fx=575.8, fy=575.8, cx=319.5, cy=239.5, width=640, height=60)


def plane(projection, range_m):
    return np.full((projection.height, projection.width), range_m, dtype=np.float32)


def stereo_at(range_m, seed=0):
    return stereo_noise(plane(FULL_KITTI, range_m), FULL_KITTI, np.random.default_rng(seed))


def kinect_at(range_m, seed=0):
    return kinect_noise(plane(KINECT, range_m), KINECT, np.random.default_rng(seed), far_m=10.0)


@pytest.mark.parametrize(
    ("measure", "near", "baseline_focal", "sigma_px"),
    [
        (stereo_at, 10.0, 718.9 * 0.54, 0.345),
        (kinect_at, 2.0, 575.8 * 0.075, math.hypot(0.08, 0.125 / 12**0.5)),
    ],
)
def test_errors_of_triangulation_grow_with_the_square_of_the_range(measure, near, baseline_focal, sigma_px):
    for range_m in (near, 2 * near):
        measured = measure(range_m)
        spread = np.nanstd(measured)
        assert spread == pytest.approx(sigma_px * range_m**2 / baseline_focal, rel=0.08)
        assert abs(np.nanmean(measured) - range_m) < 0.1 * spread
    assert np.nanstd(measure(2 * near)) / np.nanstd(measure(near)) == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize(
    ("measure", "range_m", "baseline_focal", "step_px"),
    [(stereo_at, 15.0, 718.9 * 0.54, 1 / 16), (kinect_at, 3.0, 575.8 * 0.075, 1 / 8)],
)
def test_disparities_come_in_steps(measure, range_m, baseline_focal, step_px):
    measured = measure(range_m)
    steps = baseline_focal / measured[np.isfinite(measured)].astype(float) / step_px
    assert np.abs(steps - np.round(steps)).max() < 1e-3
    assert len(np.unique(np.round(steps))) > 3


@pytest.mark.parametrize(
    ("noise", "projection", "baseline_m"), [(stereo_noise, CAMERA, 0.54), (kinect_noise, CAMERA, 0.075)]
)
def test_a_near_object_casts_a_shadow_of_lost_pixels_on_its_left_side_only(noise, projection, baseline_m):
    near, far = 2.2, 7.0
    ranges = plane(projection, far)
    ranges[:, 50:60] = near
    lost = np.stack([np.isnan(noise(ranges, projection, np.random.default_rng(s))) for s in range(5)]).mean(
        (0, 1)
    )
    width = projection.fx * baseline_m * (1 / near - 1 / far)
    shadow = np.flatnonzero(lost > 0.9)
    shadow = shadow[shadow >= math.ceil(projection.fx * baseline_m / far)]
    assert len(shadow) == pytest.approx(width, abs=1.01)
    assert shadow.max() == 49
    assert lost[50:].max() < 0.1


@pytest.mark.parametrize(("noise", "near_m", "far_m"), [(stereo_noise, 2.0, 80.0), (kinect_noise, 0.5, 8.0)])
def test_what_is_too_near_or_too_far_is_a_hole(noise, near_m, far_m):
    wide = replace(CAMERA, width=400, cx=199.5)
    for range_m in (0.6 * near_m, 1.6 * far_m):
        assert np.isnan(noise(plane(wide, range_m), wide, np.random.default_rng(0))).all()
    seen = noise(plane(wide, 2 * near_m), wide, np.random.default_rng(0))
    assert np.isfinite(seen).mean() > 0.85


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.95))
def test_holes_stay_holes_and_the_same_seed_gives_the_same_bits(seed, share):
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(2.0, 60.0, (20, 80)).astype(np.float32)
    ranges[rng.random(ranges.shape) < share] = np.nan
    for noise in (
        lambda r: stereo_noise(ranges, replace(CAMERA, height=20), r),
        lambda r: kinect_noise(ranges, replace(CAMERA, height=20), r),
        lambda r: lidar_noise(ranges, r),
    ):
        first, again = (noise(np.random.default_rng(seed)) for _ in range(2))
        assert first.dtype == np.float32
        assert np.isnan(first[np.isnan(ranges)]).all()
        assert np.array_equal(first, again, equal_nan=True)


def test_a_laser_has_two_centimetres_of_noise_at_any_range_and_loses_a_few_returns():
    for range_m in (5.0, 60.0):
        measured = lidar_noise(np.full((200, 500), range_m, np.float32), np.random.default_rng(1))
        assert np.nanstd(measured) == pytest.approx(0.02, rel=0.05)
        assert np.nanmean(measured) == pytest.approx(range_m, abs=1e-3)
        assert np.isnan(measured).mean() == pytest.approx(0.02, abs=0.003)
    for range_m in (0.5, 120.0):
        assert np.isnan(lidar_noise(np.full((9, 9), range_m, np.float32), np.random.default_rng(1))).all()


# Drives


@pytest.mark.parametrize("name", sorted(SENSORS))
def test_poses_are_level_at_the_sensor_height_and_look_along_the_motion(name, world):
    sensor = SENSORS[name]
    poses = Drive(world, sensor, 0.2).poses()
    assert np.allclose(poses[:, 2, 3], sensor.height_m)
    assert np.allclose(poses[:, :2, 3], world.route.positions_m)
    R_world_flu = poses[:, :3, :3] @ sensor.projection.R_flu_sensor.T
    assert np.allclose(R_world_flu[:, :, 2], (0, 0, 1))
    assert np.allclose(np.linalg.det(poses[:, :3, :3]), 1)
    assert alignment(R_world_flu[:, :, 0], poses[:, :3, 3]).min() > math.cos(math.radians(1))


def test_the_ground_is_measured_at_the_sensor_height(world):
    drive = Drive(world, exact(CAMERA, 1.5), 0.2)
    points = drive.measure(40).points_flu().reshape(-1, 3)
    lowest = points[np.isfinite(points[:, 2]), 2]
    assert lowest.min() == pytest.approx(-1.5, abs=1e-3)
    assert (np.abs(lowest + 1.5) < 1e-3).mean() > 0.1


@pytest.fixture
def no_traffic(monkeypatch):
    monkeypatch.setattr(Traffic, "at", lambda self, frame: merge([]))


def twins(world, count=12):
    """Frames of the first round with those of the second that have the same pose."""
    half = len(world.route) // 2
    return [(frame, frame + half) for frame in range(0, half, half // count)]


def test_a_place_looks_the_same_at_every_visit_when_no_car_is_redrawn(round_world, no_traffic):
    drive = Drive(round_world, exact(CAMERA), 0.0)
    for first, second in twins(round_world):
        assert np.array_equal(drive.measure(first).ranges_m, drive.measure(second).ranges_m, equal_nan=True)


def test_redrawn_cars_change_places_and_leave_what_stands_still(round_world, no_traffic):
    kept, redrawn = (Drive(round_world, exact(CAMERA), share) for share in (0.0, 1.0))
    pairs = twins(round_world)
    changed = 0
    for first, second in pairs:
        before, after = redrawn.measure(first).ranges_m, redrawn.measure(second).ranges_m
        differs = ~((before == after) | (np.isnan(before) & np.isnan(after)))
        changed += bool(differs.any())
        assert differs.mean() < 0.6
        assert np.array_equal(kept.measure(first).ranges_m, kept.measure(second).ranges_m, equal_nan=True)
    assert changed >= len(pairs) // 3


def test_frames_are_the_same_bits_in_any_order(world):
    frames = [0, 37, 150, 151, 300]
    forward, backward = (Drive(world, SENSORS["stereo"], 0.5) for _ in range(2))
    first = {f: forward.measure(f).ranges_m.copy() for f in frames}
    for f in reversed(frames):
        assert np.array_equal(first[f], backward.measure(f).ranges_m, equal_nan=True)
        assert np.array_equal(first[f], forward.measure(f).ranges_m, equal_nan=True)


def test_noise_of_two_frames_is_not_the_same(round_world, no_traffic):
    drive = Drive(round_world, SENSORS["stereo"], 0.0)
    first, second = twins(round_world)[0]
    assert not np.array_equal(drive.measure(first).ranges_m, drive.measure(second).ranges_m, equal_nan=True)


def test_no_parked_car_within_reach_is_left_out(world, no_traffic):
    reach_m = 100.0
    lidar = Spherical(360, 16, elevation_min_rad=-0.3, elevation_max_rad=0.05)
    slots, route = world.slots, world.route
    drive, static = Drive(world, exact(lidar), 1.0), RayScene(world.within(route.positions_m, reach_m))
    everyone = np.arange(len(slots))
    for frame in (30, 200, len(route) - 1):
        visits = np.array([np.searchsorted(s, route.arc_m[frame]) for s in visit_switches(slots, route)])
        cars = RayScene(parked_cars(world.seed, slots, everyone, visits, 1.0))
        pose = drive.pose(frame)
        expected = nearest_surface(static.cast(lidar, pose), cars.cast(lidar, pose))
        measured = drive.measure(frame).ranges_m
        near = (expected < reach_m) | (measured < reach_m)
        np.testing.assert_allclose(measured[near], expected[near], atol=1e-3)
