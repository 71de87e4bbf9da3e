"""What the command line does with wrong input: one line on stderr, status 2, nothing written."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cli_support import HEIGHT, WIDTH, depth_mm, png_bytes, run, write_recording
from depthprint import __version__


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Twelve frames without poses."""
    return write_recording(tmp_path / "recording", list(range(12)))


def assert_refused(outcome: tuple[int, str, str], *words: str) -> None:
    status, _, stderr = outcome
    assert status == 2
    assert len(stderr.strip().splitlines()) == 1
    assert stderr.startswith("depthprint: error: ")
    for word in words:
        assert word in stderr


def assert_nothing_written(folder: Path, *kept: str) -> None:
    assert sorted(path.name for path in folder.iterdir()) == sorted(kept)


def empty(folder: Path) -> str:
    for path in folder.iterdir():
        path.unlink()
    return "recording"


def truncated(folder: Path) -> str:
    path = folder / "007.png"
    path.write_bytes(path.read_bytes()[:-400])
    return "007.png"


def eight_bit(folder: Path) -> str:
    (folder / "007.png").write_bytes(png_bytes((depth_mm(7) // 16).astype(np.uint8)))
    return "007.png"


def all_invalid(folder: Path) -> str:
    (folder / "007.png").write_bytes(png_bytes(np.zeros((HEIGHT, WIDTH), dtype=np.uint16)))
    return "007.png"


def too_few_poses(folder: Path) -> str:
    (folder / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 11)
    return "poses.txt"


def nan_pose(folder: Path) -> str:
    good = "1 0 0 0 0 1 0 0 0 0 1 0\n"
    (folder / "poses.txt").write_text(good * 5 + good.replace("1 0 0 0 0", "1 0 0 nan 0") + good * 6)
    return "poses.txt"


def single_frame(folder: Path) -> str:
    for path in sorted(folder.iterdir())[1:]:
        path.unlink()
    return "frame"


@pytest.mark.parametrize(
    "damage", [empty, truncated, eight_bit, all_invalid, too_few_poses, nan_pose, single_frame]
)
def test_loops_refuse_a_damaged_recording(
    damage: Callable[[Path], str], recording: Path, tmp_path: Path
) -> None:
    word = damage(recording)
    assert_refused(run("loops", recording, "--gap", 2, "-o", tmp_path / "out"), word)
    assert_nothing_written(tmp_path, "recording")


@pytest.mark.parametrize("damage", [empty, truncated, eight_bit, all_invalid, too_few_poses, nan_pose])
def test_training_refuses_a_damaged_recording(
    damage: Callable[[Path], str], recording: Path, tmp_path: Path
) -> None:
    word = damage(recording)
    assert_refused(run("train", recording, "--preset", "handheld", "-o", tmp_path / "model.npz"), word)
    assert_nothing_written(tmp_path, "recording")


@pytest.mark.parametrize("damage", [empty, truncated, eight_bit, all_invalid])
def test_encoding_refuses_a_damaged_recording(
    damage: Callable[[Path], str], recording: Path, tmp_path: Path
) -> None:
    word = damage(recording)
    assert_refused(run("encode", recording, "--preset", "handheld", "-o", tmp_path / "signatures.npz"), word)
    assert_nothing_written(tmp_path, "recording")


@pytest.mark.parametrize("damage", [truncated, eight_bit, all_invalid])
def test_classifying_refuses_a_damaged_query(
    damage: Callable[[Path], str], recording: Path, tmp_path: Path
) -> None:
    classes = tmp_path / "classes"
    for name in ("chair", "table"):
        shutil.copytree(recording, classes / name)
    word = damage(recording)
    assert_refused(run("classify", recording / "007.png", "--against", classes), word)


def test_scoring_needs_poses(recording: Path, tmp_path: Path) -> None:
    outcome = run("evaluate", "loops", recording, "--gap", 2, "--methods", "pixel-l2", "-o", tmp_path / "out")
    assert_refused(outcome, "poses")
    assert_nothing_written(tmp_path, "recording")


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A model of preset 'handheld'."""
    from depthprint.encoder_file import shipped_model_path

    return Path(shutil.copy(shipped_model_path("handheld"), tmp_path / "model.npz"))


def test_a_model_of_other_settings_is_refused(recording: Path, model: Path, tmp_path: Path) -> None:
    outcome = run(
        "loops", recording, "--preset", "literal", "--model", model, "--gap", 2, "-o", tmp_path / "out"
    )
    assert_refused(outcome, "model.npz", "literal", "handheld")
    assert_nothing_written(tmp_path, "model.npz", "recording")


def test_a_model_cut_in_half_is_refused(recording: Path, model: Path, tmp_path: Path) -> None:
    content = model.read_bytes()
    model.write_bytes(content[: len(content) // 2])
    for arguments in (
        ("loops", recording, "--gap", 2, "-o", tmp_path / "out"),
        ("encode", recording, "-o", tmp_path / "signatures.npz"),
    ):
        assert_refused(run(*arguments, "--model", model), "model.npz")
    assert_refused(run("info", model), "model.npz")
    assert_nothing_written(tmp_path, "model.npz", "recording")


def test_a_dictionary_cut_in_half_is_refused(tmp_path: Path) -> None:
    from depthprint import Dictionary

    path = tmp_path / "dictionary.npz"
    Dictionary(np.eye(16)).save(path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert_refused(run("info", path), "dictionary.npz")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("loops", "{tmp}/nowhere", "-o", "{tmp}/out"), ("nowhere",)),
        (("loops", "-o", "{tmp}/out"), ("DATA", "simulated-street")),
        (("loops", "{tmp}/recording", "--dataset", "no-such", "-o", "{tmp}/out"), ("no_such",)),
        (
            ("loops", "{tmp}/recording", "--preset", "no-such", "--gap", "2", "-o", "{tmp}/out"),
            ("no-such", "handheld"),
        ),
        (("loops", "{tmp}/recording", "--gap", "50", "-o", "{tmp}/out"), ("12 frames", "50")),
        (
            ("loops", "{tmp}/recording", "--sensor", "lidar", "-o", "{tmp}/out"),
            ("--sensor", "simulated-street"),
        ),
        (("loops", "{tmp}/recording", "--threshold", "nan", "-o", "{tmp}/out"), ("threshold",)),
        (
            ("loops", "{tmp}/recording", "--model", "{tmp}/none.npz", "--gap", "2", "-o", "{tmp}/out"),
            ("none.npz",),
        ),
        (("loops", "{tmp}/recording", "--dataset", "simulated-street", "-o", "{tmp}/out"), ("DATA",)),
        (("loops", "--dataset", "simulated-street", "--sensor", "sonar", "-o", "{tmp}/out"), ("sonar",)),
        (("simulate", "--dataset", "generic", "-o", "{tmp}/out"), ("generic",)),
        (("simulate", "-o", "{tmp}/recording"), ("recording", "there already")),
        (("evaluate", "loops", "{tmp}/recording", "--methods", "emd,,x", "-o", "{tmp}/out"), ("--methods",)),
        (("evaluate", "loops", "{tmp}/recording", "--methods", "emd,emd", "-o", "{tmp}/out"), ("twice",)),
        (("evaluate", "objects", "{tmp}/recording", "--frames", "1,x", "-o", "{tmp}/out"), ("--frames",)),
        (("evaluate", "objects", "{tmp}/recording", "-o", "{tmp}/out"), ("recording",)),
        (("classify", "{tmp}/recording/000.png", "--against", "{tmp}/recording"), ("recording", "class")),
        (("train", "-o", "{tmp}/model.npz"), ("DATA",)),
        (("explain", "{tmp}/recording/000.png", "{tmp}/none.png", "-o", "{tmp}/out.png"), ("none.png",)),
        (("info", "{tmp}/none.npz"), ("none.npz",)),
        (("info", "{tmp}/recording/000.png"), ("000.png",)),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(
    arguments: tuple[str, ...], words: tuple[str, ...], recording: Path, tmp_path: Path
) -> None:
    assert_refused(run(*(part.format(tmp=tmp_path) for part in arguments)), *words)
    assert_nothing_written(tmp_path, "recording")


def test_a_folder_of_other_files_is_not_overwritten(recording: Path, tmp_path: Path) -> None:
    precious = tmp_path / "out"
    precious.mkdir()
    (precious / "thesis.tex").write_text("years of work")
    assert_refused(run("loops", recording, "--gap", 2, "-o", precious), "out")
    assert_nothing_written(precious, "thesis.tex")


@pytest.mark.parametrize(
    "arguments",
    [
        ("loops",),
        ("loops", "x", "--no-such-option"),
        ("no-such-verb",),
        ("loops", "x", "--gap", "-1", "-o", "y"),
    ],
)
def test_wrong_usage_ends_with_status_2(arguments: tuple[str, ...]) -> None:
    status, _, stderr = run(*arguments)
    assert status == 2
    assert "Traceback" not in stderr


def test_the_version_is_printed() -> None:
    assert run("--version") == (0, f"depthprint {__version__}\n", "")


def test_help_names_every_verb() -> None:
    status, stdout, _ = run("--help")
    assert status == 0
    for verb in ("demo", "train", "encode", "loops", "classify", "evaluate", "simulate", "explain", "info"):
        assert verb in stdout


@pytest.mark.parametrize(
    "verb",
    [
        "demo",
        "train",
        "encode",
        "loops",
        "classify",
        "evaluate loops",
        "evaluate objects",
        "simulate",
        "explain",
    ],
)
def test_every_verb_explains_itself(verb: str) -> None:
    status, stdout, _ = run(*verb.split(), "--help")
    assert status == 0
    assert "--out" in stdout or verb == "classify"


def test_an_error_is_all_that_a_real_process_says(recording: Path, tmp_path: Path) -> None:
    word = truncated(recording)
    command = [
        sys.executable,
        "-m",
        "depthprint",
        "loops",
        str(recording),
        "--gap",
        "2",
        "-o",
        str(tmp_path / "out"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert_refused((done.returncode, done.stdout, done.stderr), word)
    assert done.stdout == ""
