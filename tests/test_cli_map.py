"""``depthprint map``: built, looked into, merged and read, on small recordings made here; and its refusals."""

from __future__ import annotations

import csv
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from cli_support import run, write_recording
from depthprint.io.poses import read_tum_poses

PLACES = list(range(10))
VISITS = [3, 4, 20, 7]


def done(*arguments: object) -> str:
    status, stdout, stderr = run(*arguments)
    assert status == 0, stderr
    return stdout


def refused(*arguments: object) -> str:
    status, _, stderr = run(*arguments)
    assert status == 2
    assert len(stderr.strip().splitlines()) == 1
    return stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Ten places with poses, their map, and a second recording that visits three of them and one new place."""
    root = tmp_path_factory.mktemp("maps")
    recording = write_recording(root / "first", PLACES)
    lines = [f"1 0 0 0 0 1 0 0 0 0 1 {10.0 * place}" for place in PLACES]
    (recording / "poses.txt").write_text("\n".join(lines) + "\n")
    write_recording(root / "second", VISITS)
    done("map", "build", recording, "--points", 0.3, "-o", root / "first.db")
    return root


def test_frames_of_another_recording_are_found_in_the_map(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    stdout = done("map", "localise", folder / "second", "--map", folder / "first.db", "-o", out)
    with (out / "localised.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["place"]) for row in rows if row["localised"] == "1"] == [3, 4, 7]
    assert rows[2]["localised"] == "0"
    assert rows[1]["source"].endswith("004.png")
    last = stdout.splitlines()[-1]
    assert "3 of 4 recorded frames are localised among 10 places (detector: accepted by geometry)" in last
    results = json.loads((out / "results.json").read_text())
    assert (results["localised"], results["with_pose"], results["map"]["places"]) == (3, 3, 10)
    assert results["method"] == "detector"
    stamps, poses = read_tum_poses(out / "trajectory_tum.txt")
    assert stamps.tolist() == [0, 1, 3]
    np.testing.assert_allclose(poses[:, 2, 3], [30, 40, 70], atol=0.02)


def test_without_small_gicp_the_distance_alone_decides_on_hand_held_views(folder, tmp_path, monkeypatch):
    known = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "small_gicp" else known(name, *rest)
    )
    out = tmp_path / "out"
    done("map", "localise", folder / "second", "--map", folder / "first.db", "-o", out)
    results = json.loads((out / "results.json").read_text())
    assert (results["method"], results["localised"]) == ("emd", 3)


def test_a_given_threshold_decides(folder: Path, tmp_path: Path) -> None:
    arguments = ("map", "localise", folder / "second", "--map", folder / "first.db", "-o", tmp_path / "out")
    assert "0 of 4" in done(*arguments, "--threshold", -1)
    assert "4 of 4" in done(*arguments, "--threshold", 10)


def test_info_reads_the_map(folder: Path) -> None:
    stdout = done("map", "info", folder / "first.db")
    assert "10, 10 with a pose" in stdout
    assert "one a voxel of 0.3 m" in stdout
    assert "handheld" in stdout
    assert "first" in stdout


def test_merged_maps_hold_both(folder: Path, tmp_path: Path) -> None:
    done("map", "build", folder / "second", "-o", tmp_path / "second.db")
    both = tmp_path / "both.db"
    assert "14, 10 with a pose" in done(
        "map", "merge", folder / "first.db", tmp_path / "second.db", "-o", both
    )
    out = tmp_path / "out"
    done("map", "localise", folder / "second", "--map", both, "--threshold", 1e-6, "-o", out)
    with (out / "localised.csv").open(newline="") as file:
        rows = [(int(r["place"]), int(r["run"]), int(r["number_in_run"])) for r in csv.DictReader(file)]
    assert rows == [(3, 0, 3), (4, 0, 4), (12, 1, 2), (7, 0, 7)]


def test_what_cannot_be_is_told_in_one_line(folder: Path, tmp_path: Path) -> None:
    first, second = folder / "first.db", folder / "second"
    out = tmp_path / "out"
    assert "this file exists" in refused("map", "build", folder / "first", "-o", first)
    assert "voxel_m" in refused("map", "build", second, "--points", -1, "-o", tmp_path / "new.db")
    assert "no such place database" in refused("map", "localise", second, "--map", "nowhere.db", "-o", out)
    assert "nowhere.db" in refused("map", "info", "nowhere.db")
    assert "000.png" in refused("map", "info", second / "000.png")
    done("map", "build", second, "--preset", "literal", "-o", tmp_path / "literal.db")
    stderr = refused("map", "merge", first, tmp_path / "literal.db", "-o", tmp_path / "both.db")
    assert "made by model" in stderr
    damaged = tmp_path / "damaged.db"
    damaged.write_bytes(first.read_bytes()[:5000])
    assert "damaged" in refused("map", "localise", second, "--map", damaged, "-o", out)
    (second / "002.png").rename(tmp_path / "002.png")
    (second / "002.png").write_bytes(b"no image")
    try:
        assert "002.png" in refused("map", "build", second, "-o", tmp_path / "new.db")
        assert "002.png" in refused("map", "localise", second, "--map", first, "-o", out)
    finally:
        (tmp_path / "002.png").replace(second / "002.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["damaged.db", "literal.db"]
