"""Files appear whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from depthprint.errors import DataError
from depthprint.io.atomic import atomic_path


def test_a_file_appears_under_its_name_only_when_done(tmp_path: Path) -> None:
    target = tmp_path / "new" / "frame.png"
    with atomic_path(target) as temporary:
        assert temporary.suffix == ".png"
        assert temporary != target
        temporary.write_text("done")
        assert not target.exists()
    assert target.read_text() == "done"
    assert list(target.parent.iterdir()) == [target]


def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "model.npz"
    target.write_text("old")

    def write_half() -> None:
        with atomic_path(target) as temporary:
            temporary.write_text("half")
            raise RuntimeError("stopped")

    with pytest.raises(RuntimeError, match="stopped"):
        write_half()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="file"), atomic_path(tmp_path / "file" / "a.txt") as temporary:
        temporary.write_text("never")
