"""``evaluate objects``, ``train-objects`` and ``classify`` with what it saved."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cli_support import depth_mm, png_bytes, run, write_recording
from test_cli import write_objects


@pytest.fixture(scope="module")
def objects(tmp_path_factory) -> Path:
    return write_objects(tmp_path_factory.mktemp("data") / "objects")


def done(*arguments: object) -> str:
    status, stdout, stderr = run(*arguments)
    assert status == 0, stderr
    return stdout


def test_recogniser_is_trained_saved_described_and_asked(objects, tmp_path):
    model = tmp_path / "mine.npz"
    told = done("train-objects", objects, "-o", model)
    assert "2 classes, 36 views" in told
    assert "none of these" in told  # two classes are too few to learn it
    facts = done("info", model)
    assert "bottle, plate" in facts
    views = [objects / "plate" / "plate_1" / f"plate_1_2_{frame}_depthcrop.png" for frame in (1, 4)]
    for queries in (views[:1], views):
        lines = done("classify", *queries, "--model", model).splitlines()
        assert lines[0].startswith("plate, probability")
        assert "plate_1" in lines[0]
        shares = [float(line.split()[-1]) for line in lines[1:]]
        assert sum(shares) == pytest.approx(1.0, abs=0.002)


def test_kinds_of_places_are_learned_with_a_preset_for_places(tmp_path):
    rooms = tmp_path / "rooms"
    write_recording(rooms / "kitchen", [1, 2, 1])
    write_recording(rooms / "office", [3, 4, 4])
    model = tmp_path / "rooms.npz"
    assert "preset handheld" in done("train-objects", rooms, "--preset", "handheld", "-o", model)
    query = tmp_path / "query.png"
    query.write_bytes(png_bytes(depth_mm(3)))
    assert done("classify", query, "--model", model).startswith("office")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "--against FOLDER, or --model"),
        (["--preset", "object"], "--against FOLDER, or --model"),
        (["--against", "OBJECTS"], "compares one depth image, got 2"),
    ],
)
def test_classify_says_what_it_needs(objects, options, message):
    query = objects / "plate" / "plate_1" / "plate_1_2_1_depthcrop.png"
    named = [objects if option == "OBJECTS" else option for option in options]
    status, _, stderr = run("classify", query, query, *named)
    assert status == 2
    assert message in stderr


def test_queries_of_several_views_hidden_parts_and_trials(objects, tmp_path):
    out = tmp_path / "out"
    done(
        "evaluate", "objects", objects, "--methods", "cosine,pixel-l2,no-coding",
        "--views", 2, "--hidden", 0.3, "--trials", 3, "-o", out,
    )  # fmt: skip
    content = json.loads((out / "results.json").read_text())
    assert "3 random trials" in content["protocol"]
    assert "queries of 2 views" in content["protocol"]
    assert "30% of each query hidden" in content["protocol"]
    assert content["counts"]["folds"] == 3
    assert {path.name for path in (out / "figures").iterdir()} == {
        "confusion-cosine.png", "confusion-pixel-l2.png", "confusion-no-coding.png", "neighbours.png",
    }  # fmt: skip
    assert np.mean([f["category_accuracy_mean"] for f in content["methods"].values()]) > 0.5


def test_published_trials_are_found_beside_the_views(objects, tmp_path):
    trials = objects / "testinstance_ids.txt"
    trials.write_text("*** trial 1 ***\nbottle_1\nplate_2\n")
    try:
        done("evaluate", "objects", objects, "--methods", "pixel-l2", "-o", tmp_path / "all")
        content = json.loads((tmp_path / "all" / "results.json").read_text())
        assert "1 published trials" in content["protocol"]
        assert content["counts"]["views"] == 36
    finally:
        trials.unlink()
