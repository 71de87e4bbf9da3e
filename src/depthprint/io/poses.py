"""Trajectories: KITTI rows, TUM lines, and 4x4 matrices, one a file or stacked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError
from depthprint.io._files import read_bytes
from depthprint.io.atomic import atomic_path

__all__ = [
    "check_poses",
    "read_kitti_poses",
    "read_matrix_poses",
    "read_pose_files",
    "read_poses",
    "read_tum_poses",
    "write_kitti_poses",
    "write_matrix_poses",
    "write_tum_poses",
]

FloatArray = npt.NDArray[np.float64]

# Published poses are rounded; some come from fused rotations: an honest one stays well within this.
_ROTATION_TOLERANCE = 1e-2


def read_poses(path: Path | str) -> FloatArray:
    """(n, 4, 4) float64 T_world_sensor of a pose file; its form is told by its columns.

    12 columns are KITTI, 8 are TUM, 4 are stacked 4x4 matrices, 16 are matrices written as one row.
    Raises DataError naming file and line for any other number, for NaN, and for what is no rotation.
    """
    path = Path(path)
    rows, lines = _read_table(path)
    columns = len(rows[0])
    if columns == 12:
        return _from_kitti(path, rows, lines)
    if columns == 8:
        return _from_tum(path, rows, lines)[1]
    if columns in (4, 16):
        return _from_matrices(path, rows, lines)
    raise DataError(
        f"{path}, line {lines[0]}: expected 12 columns (KITTI), 8 (TUM), 4 or 16 (4x4), got {columns}"
    )


def read_kitti_poses(path: Path | str) -> FloatArray:
    """(n, 4, 4) poses of a file with the 12 numbers of a 3x4 matrix on each line."""
    path = Path(path)
    return _from_kitti(path, *_read_table(path))


def read_tum_poses(path: Path | str) -> tuple[FloatArray, FloatArray]:
    """Stamps (n,) in seconds and poses (n, 4, 4) of lines ``stamp tx ty tz qx qy qz qw``."""
    path = Path(path)
    return _from_tum(path, *_read_table(path))


def read_matrix_poses(path: Path | str) -> FloatArray:
    """(n, 4, 4) poses of a file of stacked 4x4 matrices (one matrix: n = 1)."""
    path = Path(path)
    return _from_matrices(path, *_read_table(path))


def read_pose_files(paths: Sequence[Path | str]) -> FloatArray:
    """(n, 4, 4) poses of files that hold one 4x4 matrix each, in the order given."""
    poses = np.empty((len(paths), 4, 4))
    for i, path in enumerate(paths):
        found = read_matrix_poses(path)
        if len(found) != 1:
            raise DataError(f"{path}: expected one 4x4 matrix, got {len(found)}")
        poses[i] = found[0]
    return poses


def check_poses(poses: npt.ArrayLike, source: str = "poses") -> FloatArray:
    """The poses as (n, 4, 4) float64; DataError naming the first that is not finite or not a rigid motion."""
    array = np.asarray(poses, dtype=np.float64)
    if array.ndim != 3 or array.shape[1:] != (4, 4):
        raise DataError(f"{source}: expected poses of shape (n, 4, 4), got {array.shape}")
    return _checked(array, [f"{source}, pose {i}" for i in range(len(array))])


def write_kitti_poses(path: Path | str, poses: npt.ArrayLike) -> None:
    """Write (n, 4, 4) poses as KITTI rows, without loss."""
    array = check_poses(poses, str(path))
    _write_table(path, array[:, :3].reshape(-1, 12))


def write_tum_poses(path: Path | str, stamps_s: npt.ArrayLike, poses: npt.ArrayLike) -> None:
    """Write stamps (n,) and poses (n, 4, 4) as TUM lines; rotations become unit quaternions."""
    array = check_poses(poses, str(path))
    stamps = np.asarray(stamps_s, dtype=np.float64)
    if stamps.shape != (len(array),) or not np.isfinite(stamps).all():
        raise DataError(f"{path}: expected {len(array)} finite stamps, got shape {stamps.shape}")
    from scipy.spatial.transform import Rotation

    quaternions = Rotation.from_matrix(array[:, :3, :3]).as_quat() if len(array) else np.empty((0, 4))
    _write_table(path, np.column_stack([stamps, array[:, :3, 3], quaternions]))


def write_matrix_poses(path: Path | str, poses: npt.ArrayLike) -> None:
    """Write (n, 4, 4) poses as stacked matrices of four lines, without loss; one pose gives a 4x4 file."""
    _write_table(path, check_poses(poses, str(path)).reshape(-1, 4))


def _read_table(path: Path) -> tuple[list[list[float]], list[int]]:
    """Numbers of each line that is not blank or a comment, and the lines' numbers; all of one length."""
    text = read_bytes(path).decode("utf-8", errors="replace")
    rows: list[list[float]] = []
    lines: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            row = [float(word) for word in words]
        except ValueError as error:
            raise DataError(f"{path}, line {number}: expected numbers, got {line[:60]!r}") from error
        if rows and len(row) != len(rows[0]):
            raise DataError(
                f"{path}, line {number}: expected {len(rows[0])} columns, as before, got {len(row)}"
            )
        rows.append(row)
        lines.append(number)
    if not rows:
        raise DataError(f"{path}: expected at least one pose, got none")
    return rows, lines


def _from_kitti(path: Path, rows: list[list[float]], lines: list[int]) -> FloatArray:
    _require_columns(path, rows, lines, (12,), "KITTI poses")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = np.array(rows).reshape(-1, 3, 4)
    return _checked(poses, _places(path, lines))


def _from_tum(path: Path, rows: list[list[float]], lines: list[int]) -> tuple[FloatArray, FloatArray]:
    _require_columns(path, rows, lines, (8,), "TUM poses")
    table = np.array(rows)
    norms = np.linalg.norm(table[:, 4:], axis=1)
    for i in np.flatnonzero(~(np.isfinite(table).all(axis=1) & (np.abs(norms - 1) < _ROTATION_TOLERANCE)))[
        :1
    ]:
        raise DataError(
            f"{path}, line {lines[i]}: expected finite numbers and a unit quaternion qx qy qz qw, "
            f"got {' '.join(f'{value:g}' for value in rows[i])}"
        )
    from scipy.spatial.transform import Rotation

    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(table[:, 4:]).as_matrix()
    poses[:, :3, 3] = table[:, 1:4]
    return table[:, 0].copy(), _checked(poses, _places(path, lines))


def _from_matrices(path: Path, rows: list[list[float]], lines: list[int]) -> FloatArray:
    _require_columns(path, rows, lines, (4, 16), "4x4 matrices")
    table = np.array(rows)
    if table.shape[1] == 4:
        if len(table) % 4:
            raise DataError(
                f"{path}: expected four lines a matrix, got {len(table)} lines, the last at line {lines[-1]}"
            )
        lines = lines[::4]
    return _checked(table.reshape(-1, 4, 4), _places(path, lines))


def _require_columns(
    path: Path, rows: list[list[float]], lines: list[int], allowed: tuple[int, ...], what: str
) -> None:
    if len(rows[0]) not in allowed:
        raise DataError(
            f"{path}, line {lines[0]}: expected {' or '.join(map(str, allowed))} columns ({what}), "
            f"got {len(rows[0])}"
        )


def _places(path: Path, lines: list[int]) -> list[str]:
    return [f"{path}, line {number}" for number in lines]


def _checked(poses: FloatArray, places: list[str]) -> FloatArray:
    finite = np.isfinite(poses).all(axis=(1, 2))
    for i in np.flatnonzero(~finite)[:1]:
        raise DataError(f"{places[i]}: expected a pose of finite numbers, got NaN or infinity")
    R = poses[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        skew = np.abs(np.einsum("nji,njk->nik", R, R) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        proper = (skew < _ROTATION_TOLERANCE) & (np.linalg.det(R) > 0)
    for i in np.flatnonzero(~proper)[:1]:
        raise DataError(f"{places[i]}: expected a rotation matrix, got columns that are not orthonormal")
    for i in np.flatnonzero((poses[:, 3] != [0, 0, 0, 1]).any(axis=1))[:1]:
        raise DataError(f"{places[i]}: expected 0 0 0 1 as the last row, got {poses[i, 3]}")
    return poses


def _write_table(path: Path | str, table: FloatArray) -> None:
    text = "".join(" ".join(map(repr, row)) + "\n" for row in table.tolist())
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="ascii")
