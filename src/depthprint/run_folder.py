"""Run folders: settings, versions, seed, results and figures of one run, written whole or not at all."""

from __future__ import annotations

import csv
import json
import math
import os
import platform
import secrets
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, is_dataclass
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from depthprint._version import __version__
from depthprint.errors import SettingsError

__all__ = ["RunFolder", "json_ready", "versions"]

_MARK = "depthprint_run"
_LIBRARIES = {
    "numpy": "numpy",
    "scipy": "scipy",
    "numba": "numba",
    "scikit-learn": "scikit-learn",
    "opencv": "opencv-python-headless",
}


def versions() -> dict[str, str]:
    """Versions of the package, Python, the libraries that compute, and the platform."""
    found = {"depthprint": __version__, "python": platform.python_version()}
    for name, distribution in _LIBRARIES.items():
        try:
            found[name] = metadata.version(distribution)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    found["platform"] = platform.platform()
    return found


def json_ready(value: Any) -> Any:
    """Turn a value into what JSON can hold: NaN and infinity become null, arrays lists, dataclasses objects.

    Raises SettingsError for anything else, rather than writing its name.
    """
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, np.generic):
        return json_ready(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, np.ndarray):
        return json_ready(value.tolist())
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, Mapping):
        return {str(k): json_ready(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        items = sorted(value) if isinstance(value, (set, frozenset)) else value
        return [json_ready(v) for v in items]
    if is_dataclass(value) and not isinstance(value, type):
        return json_ready(asdict(value))
    raise SettingsError(f"expected something that JSON can hold, got {type(value).__name__}: {value!r}")


class RunFolder:
    """Context manager: files go to a hidden sibling of ``path``, renamed to it when the block ends well.

    On any error nothing is left and an earlier run in ``path`` stays as it was. An earlier run is replaced
    whole; a folder that is neither empty nor a run, or a file, raises SettingsError on entry, before any
    work. ``settings.json`` (settings, seed, versions) is written on entry.

    >>> with RunFolder("out", {"method": "emd"}, seed=0) as run:  # doctest: +SKIP
    ...     run.write_json("results.json", {"f1_max": 0.9})
    """

    def __init__(self, path: Path | str, settings: Mapping[str, Any], *, seed: int | None = None) -> None:
        self.path = Path(path).absolute()
        self._settings = dict(settings)
        self._seed = seed
        self._folder: Path | None = None

    def __enter__(self) -> RunFolder:
        target = self.path.resolve()
        _check_replaceable(target)
        content = {_MARK: 1, "settings": self._settings, "seed": self._seed, "versions": versions()}
        text = _json_text(content)
        folder = target.parent / f".{target.name}-{secrets.token_hex(4)}"
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            folder.mkdir()
        except OSError as error:
            raise SettingsError(
                f"{self.path}: expected a folder that can be written to, got {error}"
            ) from error
        self._folder = folder
        (folder / "settings.json").write_text(text, encoding="utf-8")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        folder, self._folder = self._open_folder(), None
        try:
            if kind is None:
                _replace(folder, self.path.resolve())
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def file(self, name: str) -> Path:
        """Where to write the file ``name`` while the run is open (a plain name, or 'figures/NAME')."""
        parts = Path(name).parts
        if not parts or Path(name).is_absolute() or ".." in parts or name == "settings.json":
            raise SettingsError(f"run folder: expected a new file name inside the folder, got {name!r}")
        path = self._open_folder() / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def figure(self, name: str) -> Path:
        """Where to write the figure ``name``, in figures/; '.png' is added."""
        return self.file(f"figures/{name if name.endswith('.png') else name + '.png'}")

    def write_json(self, name: str, content: Any) -> None:
        """Write ``content`` as JSON; NaN and infinity become null."""
        self.file(name).write_text(_json_text(content), encoding="utf-8")

    def write_csv(self, name: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
        """Write a table; None, NaN and infinity become empty cells."""
        with self.file(name).open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(header)
            for row in rows:
                if len(row) != len(header):
                    raise SettingsError(f"{name}: expected rows of {len(header)} cells, got {len(row)}")
                writer.writerow([json_ready(cell) for cell in row])

    def _open_folder(self) -> Path:
        if self._folder is None:
            raise SettingsError(f"{self.path}: the run folder is not open; use it in a 'with' block")
        return self._folder


def _json_text(content: Any) -> str:
    return json.dumps(json_ready(content), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _check_replaceable(target: Path) -> None:
    if not target.exists():
        return
    if not target.is_dir():
        raise SettingsError(f"{target}: expected a folder to write the run to, this is a file")
    if any(target.iterdir()) and not _is_run(target):
        raise SettingsError(
            f"{target}: expected a new, an empty or an earlier run's folder; it holds other files"
        )


def _is_run(folder: Path) -> bool:
    try:
        content = json.loads((folder / "settings.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and _MARK in content


def _replace(folder: Path, target: Path) -> None:
    _check_replaceable(target)
    earlier = target.parent / f"{folder.name}-earlier"
    if target.exists():
        target.rename(earlier)
    try:
        folder.rename(target)
    except OSError:
        if earlier.exists():
            earlier.rename(target)
        raise
    shutil.rmtree(earlier, ignore_errors=True)
