"""The verbs of the command line, on small recordings made here."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_support import HEIGHT, WIDTH, depth_mm, png_bytes, run, write_recording

OUT_AND_BACK = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 0, 1, 2, 3, 4]


def done(*arguments: object) -> str:
    status, stdout, stderr = run(*arguments)
    assert status == 0, stderr
    return stdout


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def results(folder: Path) -> dict[str, Any]:
    content = json.loads((folder / "results.json").read_text())
    assert isinstance(content, dict)
    return content


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Ten places, then the first five again."""
    return write_recording(tmp_path / "recording", OUT_AND_BACK)


@pytest.fixture
def posed(recording: Path) -> Path:
    """The same with poses: ten metres from place to place."""
    lines = [f"1 0 0 0 0 1 0 0 0 0 1 {10.0 * scene}" for scene in OUT_AND_BACK]
    (recording / "poses.txt").write_text("\n".join(lines) + "\n")
    return recording


def test_loops_without_poses_are_found_and_not_scored(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    stdout = done("loops", recording, "--gap", 3, "-o", out)
    content = results(out)
    assert content["methods"]["emd"].keys() <= {"ms_per_query", "ms_describe", "ms_search"}
    found = {(int(r["query"]), int(r["match"])) for r in rows(out / "loops.csv") if r["accepted"] == "1"}
    assert {(10, 0), (11, 1), (12, 2), (13, 3), (14, 4)} <= found
    assert "outcome" not in rows(out / "loops.csv")[0]
    figures = sorted((out / "figures").glob("*.png"))
    assert {"difference-matrix.png", "best-loop-flow.png", "atoms-0.png"} <= {path.name for path in figures}
    assert all(str(path) in stdout for path in figures)
    assert "without poses" in stdout.splitlines()[-1]


def test_loops_with_poses_are_scored(posed: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    stdout = done("loops", posed, "--gap", 3, "-o", out)
    content = results(out)
    assert content["methods"]["emd"]["recall_at_1"] == 1.0
    assert content["methods"]["emd"]["recall_at_100_precision"] == 1.0
    assert content["loops"]["false"] == 0
    assert content["simulated"] is False
    assert {"path.png", "precision-recall.png"} <= {path.name for path in (out / "figures").iterdir()}
    assert {row["outcome"] for row in rows(out / "loops.csv")} <= {"positive", "negative", "ignore"}
    assert "there were 5 to find" in stdout


def test_a_given_threshold_decides(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done("loops", recording, "--gap", 3, "--threshold", 1e-6, "-o", out)
    accepted = [row for row in rows(out / "loops.csv") if row["accepted"] == "1"]
    assert [int(row["query"]) for row in accepted] == [10, 11, 12, 13, 14]
    assert all(float(row["distance"]) <= 1e-6 for row in accepted)
    assert results(out)["loops"]["threshold_from"] == "given"


def test_a_run_folder_says_how_it_was_made_and_is_replaced_by_the_next(
    recording: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    for seed in (1, 2):
        done("loops", recording, "--gap", 3, "--seed", seed, "-o", out)
        settings = json.loads((out / "settings.json").read_text())
        assert settings["seed"] == seed
        assert settings["settings"]["preset"] == "handheld"
        assert settings["settings"]["gap"] == 3
        assert "numpy" in settings["versions"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "recording"]


def test_a_trained_model_serves_the_other_verbs(recording: Path, tmp_path: Path) -> None:
    model, signatures = tmp_path / "model.npz", tmp_path / "signatures.npz"
    trained = done("train", recording, "--preset", "handheld", "-o", model)
    assert "15 images" in trained
    fingerprint = trained.split()[-1]
    assert fingerprint in done("info", model)
    done("encode", recording, "--model", model, "-o", signatures)
    described = done("info", signatures)
    assert fingerprint in described
    with np.load(signatures, allow_pickle=False) as archive:
        assert archive["weights_0"].shape[0] == len(OUT_AND_BACK)
        assert archive["points_0"].shape[:2] == archive["weights_0"].shape
        np.testing.assert_array_equal(archive["weights_0"][0], archive["weights_0"][10])
    out = tmp_path / "out"
    done("loops", recording, "--model", model, "--gap", 3, "-o", out)
    assert json.loads((out / "settings.json").read_text())["settings"]["fingerprint"] == fingerprint


def test_training_twice_gives_the_same_bits(recording: Path, tmp_path: Path) -> None:
    first, second = (done("train", recording, "--seed", 5, "-o", tmp_path / f"{n}.npz") for n in (1, 2))
    assert first.split()[-1] == second.split()[-1]


def test_methods_are_measured_side_by_side(posed: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    stdout = done("evaluate", "loops", posed, "--gap", 3, "--methods", "emd,pixel-l2", "-o", out)
    content = results(out)
    assert list(content["methods"]) == ["emd", "pixel-l2"]
    for figures in content["methods"].values():
        assert 0 <= figures["average_precision"] <= 1
        assert figures["ms_per_query"] > 0
    assert {"protocol", "data", "seed", "counts", "settings", "versions"} <= content.keys()
    assert len(rows(out / "metrics.csv")) == 2
    assert (out / "matches-pixel-l2.csv").is_file()
    assert (out / "figures" / "precision-recall.png").is_file()
    assert "average precision" in stdout.splitlines()[-1]


def test_an_unknown_method_is_named_with_those_there_are(posed: Path, tmp_path: Path) -> None:
    status, _, stderr = run(
        "evaluate", "loops", posed, "--gap", 3, "--methods", "magic", "-o", tmp_path / "out"
    )
    assert status == 2
    assert "magic" in stderr
    assert "pixel-l2" in stderr
    assert not (tmp_path / "out").exists()


def write_objects(root: Path) -> Path:
    """Two categories of two objects each, three views at each of the three elevations, in the UW layout."""
    rng = np.random.default_rng(3)
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    for category, tall in (("bottle", True), ("plate", False)):
        for instance in (1, 2):
            folder = root / category / f"{category}_{instance}"
            folder.mkdir(parents=True)
            for video in (1, 2, 4):
                for frame in (1, 4, 7):
                    half_width, half_height = (8, 20) if tall else (26, 7)
                    x, y = (
                        (u - WIDTH / 2) / (half_width + instance),
                        (v - HEIGHT / 2) / (half_height + 0.2 * video),
                    )
                    mask = np.maximum(abs(x), abs(y)) < 1 if not tall else abs(x) < 1 - 0.4 * (y < -0.3)
                    mask &= abs(y) < 1
                    depth = np.where(mask, 900 - 60 * np.sqrt(np.clip(1 - x**2, 0, 1)), 1200.0)
                    depth += rng.normal(0, 1.0, depth.shape)
                    stem = f"{category}_{instance}_{video}_{frame}"
                    (folder / f"{stem}_depthcrop.png").write_bytes(png_bytes(depth.astype(np.uint16)))
                    (folder / f"{stem}_maskcrop.png").write_bytes(png_bytes(mask.astype(np.uint8) * 255))
                    (folder / f"{stem}_loc.txt").write_text("280,200\n")
    return root


def test_an_object_is_named_by_its_nearest_examples(tmp_path: Path) -> None:
    objects = write_objects(tmp_path / "objects")
    query = objects / "bottle" / "bottle_1" / "bottle_1_2_4_depthcrop.png"
    lines = done("classify", query, "--against", objects).splitlines()
    assert lines[0].split()[0] == "class"
    assert [line.split()[0] for line in lines[1:]] == ["bottle", "plate"]
    assert 0 < float(lines[1].split()[1]) < float(lines[2].split()[1])
    assert str(query) not in "\n".join(lines)


def test_plain_folders_of_depth_serve_as_classes(tmp_path: Path) -> None:
    classes = tmp_path / "classes"
    write_recording(classes / "kitchen", [1, 2])
    write_recording(classes / "office", [3, 4])
    query = tmp_path / "query.png"
    query.write_bytes(png_bytes(depth_mm(3)))
    lines = done("classify", query, "--against", classes, "--preset", "handheld", "-k", 1).splitlines()
    assert len(lines) == 2
    assert lines[1].split()[:2] == ["office", "0.0000"]


def test_object_methods_are_measured_on_the_chosen_views(tmp_path: Path) -> None:
    objects, out = write_objects(tmp_path / "objects"), tmp_path / "out"
    done("evaluate", "objects", objects, "--methods", "emd,pixel-l2", "--frames", "1,7", "-o", out)
    content = results(out)
    assert content["counts"]["views"] == 2 * 2 * 3 * 2
    for figures in content["methods"].values():
        assert figures["category_accuracy_mean"] == 1.0
        assert 0 <= figures["instance_accuracy"] <= 1
        assert figures["us_per_pair"] > 0
    assert len(rows(out / "predictions.csv")) == 24


def test_why_two_images_are_near_is_explained(recording: Path, tmp_path: Path) -> None:
    figure = tmp_path / "why.png"
    same = done("explain", recording / "000.png", recording / "010.png", "-o", figure)
    other = done("explain", recording / "000.png", recording / "005.png", "-o", figure)
    assert figure.is_file()
    assert float(same.split()[1]) == pytest.approx(0.0, abs=1e-9)
    assert float(other.split()[1]) > 0.05
    assert "normals" in other
    assert "K(A)" in other


def test_info_lists_what_there_is() -> None:
    stdout = done("info")
    for word in ("handheld", "simulated_street", "scan-context-like", "ncd-gzip", "numpy"):
        assert word in stdout


def test_a_simulated_drive_is_read_back_as_a_recording(tmp_path: Path) -> None:
    folder, out = tmp_path / "drive", tmp_path / "out"
    written = done("simulate", "--seed", 3, "--every", 10, "-o", folder)
    n = len(list(folder.glob("*.png")))
    assert n > 20
    assert str(n) in written
    done("loops", folder, "--gap", 10, "-o", out)
    content = results(out)
    assert content["simulated"] is True
    assert json.loads((out / "settings.json").read_text())["settings"]["preset"] == "street"


@pytest.mark.slow
def test_loops_of_a_real_kitchen(data_root: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done("loops", data_root / "rgbd" / "redkitchen_seq01", "--every", 5, "-o", out)
    figures = results(out)["methods"]["emd"]
    assert figures["average_precision"] > 0.5
    assert (out / "figures" / "path.png").is_file()


@pytest.mark.slow
def test_loops_of_a_real_campus(data_root: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done("loops", data_root / "laser" / "freiburg-campus-corrected.log.gz", "--every", 4, "-o", out)
    assert 0 < results(out)["methods"]["emd"]["average_precision"] <= 1


def test_info_describes_a_dictionary(tmp_path: Path) -> None:
    from depthprint import Dictionary

    dictionary = Dictionary(np.eye(16))
    dictionary.save(tmp_path / "dictionary.npz")
    described = done("info", tmp_path / "dictionary.npz")
    assert dictionary.fingerprint in described
    assert "16 of 16 values" in described


def test_the_explained_distance_is_the_weighted_mean_of_its_streams(recording: Path, tmp_path: Path) -> None:
    from depthprint.runs import run_explain

    explained = run_explain(recording / "000.png", recording / "005.png", tmp_path / "flow.png")
    mean = sum(stream.weight * stream.distance for stream in explained.streams)
    assert explained.distance == pytest.approx(mean, abs=1e-9)
    assert sum(stream.weight for stream in explained.streams) == pytest.approx(1.0)
