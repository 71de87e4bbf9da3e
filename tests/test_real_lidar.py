"""Real Velodyne scans: one place is nearer than two places, whatever the direction of travel."""

import numpy as np

from depthprint.datasets.kitti_odometry import kitti_odometry
from depthprint.place_methods import load_shipped_encoder

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
