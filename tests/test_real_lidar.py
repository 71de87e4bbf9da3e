"""Real Velodyne scans: one place is nearer than two places and passes the check, whatever the direction of travel."""

import itertools
import math

import numpy as np

from depthprint.datasets.kitti_odometry import kitti_odometry
from depthprint.encoder import load_shipped_encoder
from depthprint.verification.depth_view import make_depth_view
from depthprint.verification.verifier import GeometricVerifier

DIFFERENT_PLACES_M = 5.0


def test_scans_of_one_place_are_nearer_than_all_scans_of_different_places(data_root):
    encoder = load_shipped_encoder("lidar")
    names, positions, encodings = [], [], []
    for sequence in ("00", "08"):
        scans = kitti_odometry(data_root / "kitti_odometry", sequence=sequence, source="velodyne")
        for number in range(len(scans)):
            names.append(f"{sequence}/{scans[number].source[-10:-4]}")
            far_apart = 0.0 if sequence == "00" else 1e6
            positions.append(scans.poses[number][[0, 2], 3] + far_apart)
            encodings.append(encoder.describe(scans[number]))
    index = encoder.make_index()
    for encoding in encodings:
        index.add(encoding.signatures)
    distances = np.stack([index.distances(e.signatures) for e in encodings])
    places = np.array(positions)
    apart_m = np.linalg.norm(places[:, None] - places[None], axis=2)
    different = distances[apart_m > DIFFERENT_PLACES_M]

    same_direction = distances[names.index("00/000052"), names.index("00/004501")]
    opposite = distances[names.index("08/000720"), names.index("08/001500")]
    assert same_direction < different.min()
    assert opposite < different.min()

    _, (match, _, shift) = index.query(encodings[names.index("08/000720")].signatures, k=2)
    turned_deg = encoder.shift_sectors()[shift] * 360 / encoder.settings.polar.sectors
    assert names[match] == "08/001500"
    assert abs(turned_deg - 180) <= 30


def test_geometry_accepts_scans_of_one_place_and_refuses_all_of_different_places(data_root):
    verifier = GeometricVerifier()
    scans = kitti_odometry(data_root / "kitti_odometry", sequence="00", source="velodyne")
    views = [make_depth_view(scans[number]) for number in range(len(scans))]
    positions = scans.poses[:, [0, 2], 3]
    accepted = 0
    for first, second in itertools.combinations(range(len(views)), 2):
        found = verifier.verify(views[second], views[first], yaw_rad=None)
        apart_m = np.linalg.norm(positions[first] - positions[second])
        assert found.accepted == (apart_m < DIFFERENT_PLACES_M)
        accepted += found.accepted
        if found.accepted:
            assert found.agreement > 0.6
            # between the laps the given poses themselves disagree by some decimetres
            assert abs(found.offset_m - apart_m) < 1.0
    assert accepted == 3


def test_geometry_accepts_a_real_return_from_the_opposite_direction(data_root):
    scans = kitti_odometry(data_root / "kitti_odometry", sequence="08", source="velodyne")
    views = [make_depth_view(scans[number]) for number in (0, 1)]
    # as near as the descriptor's shift tells the turn
    found = GeometricVerifier().verify(views[1], views[0], yaw_rad=math.radians(204))
    assert found.accepted
    turn_deg = math.degrees(math.acos((np.trace(found.T_match_query[:3, :3]) - 1) / 2))
    assert turn_deg > 140
