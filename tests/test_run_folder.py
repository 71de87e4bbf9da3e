from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from depthprint.errors import SettingsError
from depthprint.run_folder import RunFolder, json_ready, versions


def test_run_holds_settings_results_tables_and_figures(tmp_path):
    out = tmp_path / "deep" / "out"
    with RunFolder(out, {"preset": "street", "lambda": np.float64(0.5)}, seed=7) as run:
        assert not out.exists()
        run.write_json("results.json", {"f1_max": np.float32(0.5), "ap": float("nan")})
        run.write_csv("loops.csv", ["query", "distance"], [[np.int64(1), 0.25], [2, float("inf")], [3, None]])
        run.figure("path").write_bytes(b"png")
    settings = json.loads((out / "settings.json").read_text())
    assert settings["settings"] == {"preset": "street", "lambda": 0.5}
    assert settings["seed"] == 7
    assert {"depthprint", "python", "numpy", "scipy", "numba", "scikit-learn", "opencv", "platform"} <= set(
        settings["versions"]
    )
    assert json.loads((out / "results.json").read_text()) == {"f1_max": 0.5, "ap": None}
    with (out / "loops.csv").open() as stream:
        assert list(csv.reader(stream)) == [["query", "distance"], ["1", "0.25"], ["2", ""], ["3", ""]]
    assert (out / "figures" / "path.png").read_bytes() == b"png"
    assert list(out.parent.iterdir()) == [out]


def test_failed_run_leaves_nothing(tmp_path):
    def run_and_fail() -> None:
        with RunFolder(tmp_path / "out", {}) as run:
            run.write_json("results.json", {})
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        run_and_fail()
    assert list(tmp_path.iterdir()) == []


def test_failed_run_keeps_the_earlier_one_and_a_good_one_replaces_it_whole(tmp_path):
    out = tmp_path / "out"
    with RunFolder(out, {"n": 1}) as run:
        run.write_csv("old.csv", ["a"], [])
    with pytest.raises(RuntimeError, match="no"), RunFolder(out, {"n": 2}):
        raise RuntimeError("no")
    assert json.loads((out / "settings.json").read_text())["settings"] == {"n": 1}
    with RunFolder(out, {"n": 3}) as run:
        run.write_json("results.json", {})
    assert sorted(p.name for p in out.iterdir()) == ["results.json", "settings.json"]
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize("content", ["{}", "not json", '["depthprint_run"]'])
def test_folder_of_others_is_never_replaced(tmp_path, content):
    out = tmp_path / "out"
    out.mkdir()
    (out / "settings.json").write_text(content)
    with pytest.raises(SettingsError, match="other files"), RunFolder(out, {}):
        raise AssertionError("must not start")
    assert (out / "settings.json").read_text() == content
    assert list(tmp_path.iterdir()) == [out]


def test_file_in_the_way_is_refused_and_an_empty_folder_is_used(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(SettingsError, match="this is a file"), RunFolder(tmp_path / "file", {}):
        raise AssertionError("must not start")
    (tmp_path / "empty").mkdir()
    with RunFolder(tmp_path / "empty", {}):
        pass
    assert (tmp_path / "empty" / "settings.json").is_file()


def test_parent_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(SettingsError, match="can be written to"), RunFolder(tmp_path / "file" / "out", {}):
        raise AssertionError("must not start")


@pytest.mark.parametrize("name", ["../escape.json", "/tmp/escape.json", "", "settings.json"])
def test_files_stay_inside_the_run(tmp_path, name):
    with pytest.raises(SettingsError, match="file name"), RunFolder(tmp_path / "out", {}) as run:
        run.file(name)


def test_closed_run_takes_no_files(tmp_path):
    run = RunFolder(tmp_path / "out", {})
    with pytest.raises(SettingsError, match="not open"):
        run.write_json("results.json", {})


def test_row_of_another_length_is_refused(tmp_path):
    with pytest.raises(SettingsError, match="2 cells"), RunFolder(tmp_path / "out", {}) as run:
        run.write_csv("loops.csv", ["a", "b"], [[1]])


@dataclass(frozen=True)
class Point:
    x: float
    where: Path


def test_json_form_of_what_results_hold():
    value = {
        1: [np.bool_(True), np.array([1.0, np.nan])],
        "p": Point(float("-inf"), Path("a/b")),
        "s": {2, 1},
    }
    assert json_ready(value) == {"1": [True, [1.0, None]], "p": {"x": None, "where": "a/b"}, "s": [1, 2]}
    with pytest.raises(SettingsError, match="object"):
        json_ready(object())


def test_versions_name_the_package():
    from depthprint._version import __version__

    assert versions()["depthprint"] == __version__
