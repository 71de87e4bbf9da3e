"""Whatever is cut from a file or flipped in it, a reader gives a result or a DataError with its name."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.errors import DataError
from depthprint.io.carmen import read_carmen_log
from depthprint.io.depth_image import read_depth_image, write_depth_npy, write_depth_png
from depthprint.io.pcd import write_pcd
from depthprint.io.ply import write_ply
from depthprint.io.point_cloud import PointCloud, read_point_cloud
from depthprint.io.poses import read_poses, write_kitti_poses, write_matrix_poses, write_tum_poses
from depthprint.io.velodyne import write_velodyne_bin

RNG = np.random.default_rng(0)
RANGES_M = RNG.uniform(0.5, 9, (12, 9))
CLOUD = PointCloud(RNG.normal(0, 9, (20, 3)).round(1), 20, intensity=np.zeros(20))
POSES = np.tile(np.eye(4), (4, 1, 1))
LOG = "".join(f"FLASER 3 1.5 2.5 {i} 0 0 0 0 0 0 {i} robot {i}\n" for i in range(1, 9))
PGM = b"P5\n9 12\n65535\n" + (RANGES_M * 1000).astype(">u2").tobytes()
PLAIN_PGM = b"P2\n3 2\n9999\n1 2 3\n4 5 6\n"

Writer = Callable[[Path], object]
FILES: dict[str, tuple[Writer, Callable[[Path], object]]] = {
    "a.png": (lambda p: write_depth_png(p, RANGES_M), read_depth_image),
    "a.npy": (lambda p: write_depth_npy(p, RANGES_M), read_depth_image),
    "a.npz": (lambda p: np.savez(p, RANGES_M), read_depth_image),
    "packed.npz": (lambda p: np.savez_compressed(p, depth=RANGES_M), read_depth_image),
    "a.pgm": (lambda p: p.write_bytes(PGM), read_depth_image),
    "plain.pgm": (lambda p: p.write_bytes(PLAIN_PGM), read_depth_image),
    "a.bin": (lambda p: write_velodyne_bin(p, np.ones((5, 4))), read_point_cloud),
    "ascii.pcd": (lambda p: write_pcd(p, CLOUD, "ascii"), read_point_cloud),
    "binary.pcd": (lambda p: write_pcd(p, CLOUD, "binary"), read_point_cloud),
    "packed.pcd": (lambda p: write_pcd(p, CLOUD, "binary_compressed"), read_point_cloud),
    "ascii.ply": (lambda p: write_ply(p, CLOUD, "ascii"), read_point_cloud),
    "binary.ply": (lambda p: write_ply(p, CLOUD), read_point_cloud),
    "kitti.txt": (lambda p: write_kitti_poses(p, POSES), read_poses),
    "tum.txt": (lambda p: write_tum_poses(p, np.arange(4.0), POSES), read_poses),
    "matrix.txt": (lambda p: write_matrix_poses(p, POSES), read_poses),
    "a.log": (lambda p: p.write_text(LOG), read_carmen_log),
    "a.log.gz": (lambda p: p.write_bytes(gzip.compress(LOG.encode(), mtime=0)), read_carmen_log),
}


def error_message(read: Callable[[Path], object], path: Path) -> str | None:
    try:
        read(path)
    except DataError as error:
        return str(error)
    return None


@pytest.fixture(scope="module")
def whole_files(tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("whole")
    contents = {}
    for name, (write, read) in FILES.items():
        write(folder / name)
        read(folder / name)
        contents[name] = (folder / name).read_bytes()
    return contents


@pytest.mark.parametrize("name", FILES)
@settings(max_examples=60, deadline=None, derandomize=True)
@given(data=st.data())
def test_damage_gives_a_data_error_or_a_result(whole_files, tmp_path_factory, name: str, data) -> None:
    content = bytearray(whole_files[name])
    if data.draw(st.booleans(), label="cut"):
        content = content[: data.draw(st.integers(0, len(content) - 1), label="length")]
    for _ in range(data.draw(st.integers(0, 3), label="flips")):
        if content:
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / f"damaged-{name}"
    path.write_bytes(content)
    message = error_message(FILES[name][1], path)
    assert message is None or path.name in message
