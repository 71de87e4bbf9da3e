"""Other programs' matches: read with care, scored as our own."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from cli_support import run, write_recording
from depthprint.baselines.pixel_l2 import PixelL2Recognizer
from depthprint.errors import DataError
from depthprint.evaluation.ground_truth import TruthMatrix
from depthprint.evaluation.imported import read_match_file, score_matches
from depthprint.evaluation.loops import evaluate_loops
from depthprint.evaluation.report import loop_records
from test_evaluation_loops import two_laps

GAP = 2


@pytest.fixture
def truth() -> TruthMatrix:
    """Ten frames; frame i + 5 is at the place of frame i, everything else is elsewhere."""
    values = np.full((10, 10), -1, dtype=np.int8)
    for i in range(5):
        values[i + 5, i] = 1
    return TruthMatrix(values, GAP, "by hand")


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_matches_are_scored_by_the_truth(truth, tmp_path):
    file = write(
        tmp_path / "a.csv",
        "score,query,match,note\n0.9,5,0,right\n0.8,6,1,right\n0.7,7,3,wrong\n0.6,8,3,right\n0.1,9,-1,none\n",
    )
    method = score_matches("theirs", read_match_file(file, truth), truth)
    assert method.metrics.recall_at_100_precision == pytest.approx(2 / 5)
    assert method.metrics.recall_at_1 == pytest.approx(3 / 5)
    assert [r.outcome for r in method.records] == [0, 0, 1, 1, -1, 1, 0]
    assert np.isnan(method.ms_per_query)


def test_our_own_file_of_matches_scores_as_it_did(tmp_path):
    evaluation = evaluate_loops(two_laps(), {"own": PixelL2Recognizer()}, resamples=5)
    (own,) = evaluation.methods
    header, rows = loop_records(own)
    with open(tmp_path / "own.csv", "w", newline="") as stream:
        csv.writer(stream).writerows([header, *rows])
    again = score_matches(
        "own", read_match_file(tmp_path / "own.csv", evaluation.truth), evaluation.truth, resamples=5
    )
    assert again.metrics == own.metrics
    assert again.intervals == own.intervals


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["columns query, match, score", "got nothing"]),
        ("query,match\n5,0\n", ["columns query, match, score", "got query, match"]),
        ("query,match,score\n5,0\n", ["line 2", "as many cells"]),
        ("query,match,score\n5,0,1,7\n", ["line 2", "as many cells"]),
        ("query,match,score\n5,0,0.5\nsix,0,0.5\n", ["line 3", "whole query", "'six'"]),
        ("query,match,score\n5,0.5,0.5\n", ["line 2", "whole match", "'0.5'"]),
        ("query,match,score\n5,0,nan\n", ["line 2", "finite score", "'nan'"]),
        ("query,match,score\n5,0,\n", ["line 2", "finite score", "''"]),
        ("query,match,score\n10,0,1\n", ["line 2", "query in 0..9", "got 10"]),
        ("query,match,score\n5,3,1\n", ["line 2", "over 2 frames older than query 5", "got 3"]),
        ("query,match,score\n5,0,1\n5,1,1\n", ["line 3", "one row a query", "query 5"]),
    ],
)
def test_wrong_files_are_refused_with_file_and_line(text, words, truth, tmp_path):
    file = write(tmp_path / "theirs.csv", text)
    with pytest.raises(DataError) as raised:
        read_match_file(file, truth)
    for word in ["theirs.csv", *words]:
        assert word in str(raised.value)


def test_absent_and_binary_files_are_refused(truth, tmp_path):
    with pytest.raises(DataError, match=r"absent\.csv"):
        read_match_file(tmp_path / "absent.csv", truth)
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00query")
    with pytest.raises(DataError, match=r"binary\.csv"):
        read_match_file(tmp_path / "binary.csv", truth)


@pytest.fixture
def recording(tmp_path):
    """Two laps of six places, with a pose a frame along x."""
    folder = write_recording(tmp_path / "recording", [*range(6), *range(6)])
    rows = "".join(f"1 0 0 {20 * (i % 6)} 0 1 0 0 0 0 1 0\n" for i in range(12))
    write(folder / "poses.txt", rows)
    return folder


def evaluate(recording, tmp_path, *options):
    return run("evaluate", "loops", recording, "--gap", 2, *options, "-o", tmp_path / "out")


def test_imported_matches_stand_in_the_table_and_beside_our_own(recording, tmp_path):
    rows = "".join(f"{i + 6},{i},{1 - i / 10}\n" for i in range(6))
    file = write(tmp_path / "theirs.csv", "query,match,score\n" + rows)
    status, stdout, _ = evaluate(recording, tmp_path, "--methods", "pixel-l2", "--import", f"theirs={file}")
    assert status == 0
    assert "theirs" in stdout
    assert (tmp_path / "out" / "matches-theirs.csv").is_file()
    status, stdout, _ = evaluate(recording, tmp_path, "--methods", "none", "--import", f"theirs={file}")
    assert status == 0
    assert "average precision 1.000" in stdout


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("theirs", ["--import", "NAME=FILE.csv", "'theirs'"]),
        ("pixel-l2={file}", ["--import", "'pixel-l2'", "methods"]),
        ("theirs={file}", ["theirs.csv", "line 3", "'two'"]),
    ],
)
def test_the_command_refuses_wrong_imports_in_one_line(option, words, recording, tmp_path):
    file = write(tmp_path / "theirs.csv", "query,match,score\n6,0,1\n7,two,1\n")
    status, _, stderr = evaluate(
        recording, tmp_path, "--methods", "pixel-l2", "--import", option.format(file=file)
    )
    assert status == 2
    assert len(stderr.strip().splitlines()) == 1
    for word in words:
        assert word in stderr
    assert not (tmp_path / "out").exists()
