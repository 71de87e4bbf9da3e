"""The page on SLAM: its Python runs as it stands, from top to bottom, and does what the page says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from depthprint.place_database import PlaceDatabase
from depthprint.pose_graph import read_g2o

PAGE = Path(__file__).resolve().parents[1] / "docs" / "slam.md"


@pytest.mark.slow
def test_the_page_on_slam_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("small_gicp")
    pytest.importorskip("gtsam")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 5
    names: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    street = names["street"]
    assert names["late"].query == len(street) - 6
    assert names["late"].candidates == len(street) - 6 - 25
    with PlaceDatabase.open("street.db") as database:
        assert len(database) == len(street)
    graph = read_g2o("graph.g2o")
    assert len(graph.loops) == len(names["loops"]) >= 5
    for edge in graph.loops:
        expected = np.linalg.inv(street.poses[edge.first]) @ street.poses[edge.second]
        assert np.linalg.norm(edge.T_first_second[:3, 3] - expected[:3, 3]) < 0.5
    assert (names["optimized"].loop_weights > 0.5).all()
    corrected = names["corrected"].atPose3(len(street) - 1).matrix()
    np.testing.assert_allclose(corrected[:3, 3], street.poses[-1, :3, 3], atol=1.0)
    assert "; that place is at [" in capsys.readouterr().out
