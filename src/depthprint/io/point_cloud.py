"""Point clouds of any known format."""

from __future__ import annotations

from pathlib import Path

from depthprint.errors import DataError
from depthprint.io._point_cloud import PointCloud
from depthprint.io.pcd import read_pcd
from depthprint.io.ply import read_ply
from depthprint.io.velodyne import read_velodyne_bin

__all__ = ["POINT_CLOUD_SUFFIXES", "PointCloud", "read_point_cloud"]

POINT_CLOUD_SUFFIXES = (".bin", ".pcd", ".ply")


def read_point_cloud(path: Path | str) -> PointCloud:
    """Read a Velodyne ``.bin``, ``.pcd`` or ``.ply`` file by its suffix; DataError for any other."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".pcd":
        return read_pcd(path)
    if suffix == ".ply":
        return read_ply(path)
    if suffix == ".bin":
        scan = read_velodyne_bin(path)
        return PointCloud(scan[:, :3], len(scan), intensity=scan[:, 3], source=str(path))
    raise DataError(f"{path}: expected a point cloud ({', '.join(POINT_CLOUD_SUFFIXES)}), got {suffix!r}")
