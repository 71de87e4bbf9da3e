"""The figure of trajectories: what is drawn, in which colours, and what is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from depthprint.errors import DataError
from depthprint.visualization.trajectories import draw_trajectories

ANGLES = np.linspace(0, 4 * np.pi, 80)
CIRCLE = 30 * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
DRIFTED = CIRCLE + np.linspace(0, 12, 80)[:, None]
ERRORS = {"odometry": 6.0, "corrected": 0.2}


def colors(path) -> dict[str, int]:
    image = cv2.imread(str(path))
    found = {}
    for name, rgb in (
        ("odometry", "D55E00"),
        ("corrected", "0072B2"),
        ("right", "009E73"),
        ("wrong", "CC0000"),
    ):
        bgr = [int(rgb[k : k + 2], 16) for k in (4, 2, 0)]
        found[name] = int((np.abs(image.astype(int) - bgr).max(axis=2) < 12).sum())
    return found


def test_paths_and_both_kinds_of_loops_are_drawn(tmp_path):
    loops = np.array([[5, 44], [10, 50], [3, 60]])
    right = np.array([True, True, False])
    path = draw_trajectories(
        CIRCLE, DRIFTED, CIRCLE + 0.1, loops, right, tmp_path / "a.png", errors_m=ERRORS, simulated=True
    )
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    assert all(count > 30 for count in colors(path).values())


def test_without_loops_there_are_only_paths(tmp_path):
    none = np.empty((0, 2), dtype=np.int64)
    path = draw_trajectories(CIRCLE, DRIFTED, CIRCLE, none, none[:, 0], tmp_path / "a.png", errors_m=ERRORS)
    found = colors(path)
    assert found["odometry"] > 1000
    assert found["wrong"] == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"corrected_m": CIRCLE[1:]}, r"three paths \(n, 2\)"),
        ({"true_m": np.zeros((80, 3))}, r"three paths \(n, 2\)"),
        ({"drifted_m": np.full((80, 2), np.nan)}, "finite"),
        ({"loops": np.array([[3, 80]])}, "among 80 frames"),
        ({"right": np.array([True, False])}, "whether each is right"),
        ({"errors_m": {"odometry": 1.0}}, "errors of odometry and corrected"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, changes, message):
    arguments = {
        "true_m": CIRCLE,
        "drifted_m": DRIFTED,
        "corrected_m": CIRCLE,
        "loops": np.array([[5, 44]]),
        "right": np.array([True]),
        "errors_m": ERRORS,
    }
    with pytest.raises(DataError, match=message):
        draw_trajectories(**(arguments | changes), path=tmp_path / "a.png")
    assert not list(tmp_path.iterdir())
