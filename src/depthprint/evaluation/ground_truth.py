"""Ground truth of loops: which earlier frames a query may be matched with, must not be, or either way.

Three values for every candidate pair: positive, negative, and 'ignore' between them, so that a match which is
arguable counts for nobody. Made from poses alone (``loop_ground_truth``), or read from the matrices that
others published (``read_loop_matrix``).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.datasets.base import LoopTruth, RangeSequence
from depthprint.errors import DataError, SettingsError
from depthprint.projection import Pinhole

__all__ = [
    "IGNORE",
    "NEGATIVE",
    "POSITIVE",
    "TruthMatrix",
    "horizontal_basis",
    "horizontal_headings",
    "horizontal_positions_m",
    "loop_ground_truth",
    "read_loop_matrix",
]

POSITIVE = 1
IGNORE = 0
NEGATIVE = -1

Progress = Callable[[int, int], None]
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class TruthMatrix:
    """Truth of every candidate pair: ``values[i, j]`` of query i and candidate j, where ``i - j > gap``.

    values: (n, n) int8, read-only: 1 positive, 0 ignore (and every pair that is no candidate), -1 negative.
    gap: frames that a candidate must be older by, exclusively.
    rule: in words, for reports.
    """

    values: npt.NDArray[np.int8]
    gap: int
    rule: str

    def __post_init__(self) -> None:
        given = np.asarray(self.values)
        if given.ndim != 2 or given.shape[0] != given.shape[1]:
            raise DataError(f"TruthMatrix: expected a square matrix, got shape {given.shape}")
        if self.gap < 0:
            raise SettingsError(f"TruthMatrix: expected gap >= 0, got {self.gap}")
        if not np.isin(given, (NEGATIVE, IGNORE, POSITIVE)).all():
            raise DataError("TruthMatrix: expected the values 1, 0 and -1 only")
        values = np.tril(given.astype(np.int8), -(self.gap + 1))
        values.setflags(write=False)
        object.__setattr__(self, "values", values)

    def __len__(self) -> int:
        return len(self.values)

    def candidates(self, query: int) -> int:
        """Return how many frames (0, 1, ...) are candidates of ``query``: the recogniser's ``limit``."""
        return max(0, query - self.gap)

    @property
    def has_positive(self) -> npt.NDArray[np.bool_]:
        """(n,) whether each query has a positive candidate."""
        return np.asarray((self.values == POSITIVE).any(axis=1))

    def counts(self) -> dict[str, int]:
        """Return frames, queries with candidates, positive queries, and pairs of each value."""
        n = len(self)
        positive = int((self.values == POSITIVE).sum())
        negative = int((self.values == NEGATIVE).sum())
        older = np.maximum(0, np.arange(n) - self.gap)
        return {
            "frames": n,
            "queries": int((older > 0).sum()),
            "positive_queries": int(self.has_positive.sum()),
            "positive_pairs": positive,
            "ignored_pairs": int(older.sum()) - positive - negative,
            "negative_pairs": negative,
        }


def loop_ground_truth(
    sequence: RangeSequence, truth: LoopTruth | None = None, progress: Progress | None = None
) -> TruthMatrix:
    """Make the truth of all candidate pairs from the poses (and, for 'overlap', the depth) of a sequence.

    'distance': metres on the horizontal plane, orthogonal to ``world_up``. Positive when strictly under
    ``positive`` and the headings differ by at most ``heading_deg``; negative when strictly over ``negative``,
    whatever the heading. A heading is the sensor's forward axis (z of a pinhole camera, x otherwise),
    flattened.

    'overlap': the share of one view's depth that the other confirms when reprojected, within
    ``overlap_tolerance_m``. Positive when over ``positive`` both ways. Negative when under ``negative`` both
    ways: a close-up of part of a view does show the same place, so one large share is enough to be ignored.

    Raises DataError without usable poses, SettingsError for a rule that cannot be.
    """
    rule = sequence.truth if truth is None else truth
    _check_rule(rule)
    if rule.kind == "distance":
        return TruthMatrix(_distance_values(sequence, rule), rule.gap, _describe_rule(rule))
    from depthprint.evaluation.view_overlap import view_overlaps

    shares = view_overlaps(sequence, rule.gap, rule.overlap_tolerance_m, progress)
    values = np.zeros((len(sequence), len(sequence)), dtype=np.int8)
    values[np.maximum(shares.forward, shares.backward) < rule.negative] = NEGATIVE
    values[np.minimum(shares.forward, shares.backward) > rule.positive] = POSITIVE
    return TruthMatrix(values, rule.gap, _describe_rule(rule))


def read_loop_matrix(path: Path | str, gap: int = 100) -> TruthMatrix:
    """Read a published loop matrix (MATLAB file, one square 0/1 variable, query x match) as truth.

    Such a matrix has two values: what is not positive is negative, nothing is ignored but pairs within
    ``gap``.
    Raises DataError naming the file.
    """
    from scipy.io import loadmat

    path = Path(path)
    if not path.is_file():
        raise DataError(f"{path}: expected a loop matrix, there is no such file")
    try:
        content = loadmat(path)
    except (OSError, ValueError, TypeError, KeyError, NotImplementedError, struct.error, zlib.error) as error:
        raise DataError(f"{path}: expected a MATLAB file (version 5) with a loop matrix: {error}") from error
    matrices = {k: v for k, v in content.items() if not k.startswith("__") and isinstance(v, np.ndarray)}
    square = [v for v in matrices.values() if v.ndim == 2 and v.shape[0] == v.shape[1] > 1]
    if len(square) != 1:
        found = ", ".join(f"{k} {v.shape}" for k, v in matrices.items()) or "none"
        raise DataError(f"{path}: expected one square matrix, found {found}")
    if not np.isin(square[0], (0, 1)).all():
        raise DataError(f"{path}: expected a matrix of 0 and 1 only")
    positive = square[0] == 1
    values = np.where(positive | positive.T, POSITIVE, NEGATIVE).astype(np.int8)
    return TruthMatrix(values, gap, f"loop matrix {path.name}; candidates over {gap} frames older")


def horizontal_basis(world_up: tuple[float, float, float]) -> FloatArray:
    """Two orthonormal rows (2, 3) spanning the plane orthogonal to ``world_up``, right-handed from above."""
    up = np.asarray(world_up, dtype=np.float64)
    length = np.linalg.norm(up)
    if up.shape != (3,) or not np.isfinite(length) or length < 1e-9:
        raise SettingsError(f"world_up: expected a direction of three numbers, got {world_up}")
    up = up / length
    axes = np.eye(3)
    first = axes[0] if abs(up[0]) < 0.9 else axes[1]
    first = first - (first @ up) * up
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


def horizontal_positions_m(poses: FloatArray, world_up: tuple[float, float, float]) -> FloatArray:
    """Sensor positions (n, 2) in metres on the horizontal plane, from T_world_sensor (n, 4, 4)."""
    return np.asarray(poses[:, :3, 3] @ horizontal_basis(world_up).T)


def horizontal_headings(sequence: RangeSequence) -> FloatArray:
    """Unit vectors (n, 2) of the sensor's forward axis on the horizontal plane; DataError where vertical."""
    poses = _finite_poses(sequence)
    forward = poses[:, :3, 2] if isinstance(sequence[0].projection, Pinhole) else poses[:, :3, 0]
    flat = forward @ horizontal_basis(sequence.world_up).T
    length = np.linalg.norm(flat, axis=1)
    if (length < 1e-6).any():
        frame = int(np.argmax(length < 1e-6))
        raise DataError(
            f"{sequence.name}, frame {frame}: the sensor looks straight up or down and has no heading"
        )
    return np.asarray(flat / length[:, None])


def _distance_values(sequence: RangeSequence, rule: LoopTruth) -> npt.NDArray[np.int8]:
    positions_m = horizontal_positions_m(_finite_poses(sequence), sequence.world_up)
    headings = None if rule.heading_deg is None else horizontal_headings(sequence)
    n = len(positions_m)
    values = np.zeros((n, n), dtype=np.int8)
    for i in range(rule.gap + 1, n):
        older = i - rule.gap
        distance_m = np.linalg.norm(positions_m[:older] - positions_m[i], axis=1)
        positive = distance_m < rule.positive
        if headings is not None and rule.heading_deg is not None:
            cosine = headings[:older] @ headings[i]
            positive &= cosine >= np.cos(np.radians(rule.heading_deg)) - 1e-12
        values[i, :older][distance_m > rule.negative] = NEGATIVE
        values[i, :older][positive] = POSITIVE
    return values


def _finite_poses(sequence: RangeSequence) -> FloatArray:
    if sequence.poses is None:
        raise DataError(f"{sequence.name}: ground truth of loops needs poses, and the sequence has none")
    finite = np.isfinite(sequence.poses).all(axis=(1, 2))
    if not finite.all():
        raise DataError(f"{sequence.name}: the pose of frame {int(np.argmin(finite))} is not finite")
    return sequence.poses


def _check_rule(rule: LoopTruth) -> None:
    if rule.kind not in ("distance", "overlap"):
        raise SettingsError(f"LoopTruth: expected kind 'distance' or 'overlap', got {rule.kind!r}")
    if rule.gap < 0:
        raise SettingsError(f"LoopTruth: expected gap >= 0, got {rule.gap}")
    if rule.kind == "distance" and not 0 < rule.positive <= rule.negative:
        raise SettingsError(
            f"LoopTruth: expected 0 < positive <= negative, got {rule.positive}, {rule.negative} m"
        )
    if rule.kind == "overlap" and not 0 <= rule.negative <= rule.positive < 1:
        raise SettingsError(
            "LoopTruth: expected overlaps 0 <= negative <= positive < 1, got "
            f"{rule.negative}, {rule.positive}"
        )
    if rule.kind == "overlap" and not rule.overlap_tolerance_m > 0:
        raise SettingsError(f"LoopTruth: expected overlap_tolerance_m > 0, got {rule.overlap_tolerance_m}")
    if rule.heading_deg is not None and not 0 < rule.heading_deg <= 180:
        raise SettingsError(f"LoopTruth: expected heading_deg in (0, 180] or None, got {rule.heading_deg}")


def _describe_rule(rule: LoopTruth) -> str:
    older = f"candidates over {rule.gap} frames older"
    if rule.kind == "overlap":
        return (
            f"{older}; positive: view overlap > {rule.positive:g} both ways, "
            f"negative: < {rule.negative:g} both ways (depth within {rule.overlap_tolerance_m:g} m)"
        )
    heading = "" if rule.heading_deg is None else f" and heading within {rule.heading_deg:g} deg"
    return f"{older}; positive: < {rule.positive:g} m{heading}, negative: > {rule.negative:g} m, horizontal"
