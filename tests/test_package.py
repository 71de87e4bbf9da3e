"""The package as a whole: versions that agree, names that exist, an import that stays light."""

from __future__ import annotations

import importlib
import json
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import depthprint

ROOT = Path(__file__).resolve().parents[1]
HEAVY = ("numba", "matplotlib", "cv2", "sklearn", "trimesh", "scipy", "rich", "typer", "numpy")


def modules_after(statement: str) -> set[str]:
    code = f"{statement}\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


def all_modules() -> list[str]:
    found = pkgutil.walk_packages(depthprint.__path__, "depthprint.")
    return [module.name for module in found if not module.name.endswith("__main__")]


def test_version_is_the_newest_of_the_changelog() -> None:
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest is not None
    assert newest.group(1) == depthprint.__version__


def test_version_is_that_of_the_citation() -> None:
    cited = re.search(r"^version: (\S+)", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert cited is not None
    assert cited.group(1) == depthprint.__version__


def test_importing_the_package_pulls_in_nothing_heavy() -> None:
    loaded = modules_after("import depthprint")
    assert not [name for name in HEAVY if name in loaded]


def test_a_range_image_needs_no_compiler_and_no_plotting() -> None:
    loaded = modules_after(
        "import depthprint; depthprint.RangeImage; depthprint.Signature; depthprint.DataError"
    )
    assert not {"numba", "matplotlib", "cv2", "sklearn", "trimesh"} & loaded


def test_help_of_the_command_line_loads_no_computation() -> None:
    loaded = modules_after("import depthprint.cli.main")
    assert not {"numba", "matplotlib", "cv2", "sklearn", "trimesh", "scipy"} & loaded


@pytest.mark.parametrize("name", depthprint.__all__)
def test_every_public_name_can_be_had(name: str) -> None:
    assert getattr(depthprint, name) is not None


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_thing"):
        _ = depthprint.no_such_thing  # type: ignore[attr-defined]


def test_dir_lists_the_public_names() -> None:
    assert set(depthprint.__all__) <= set(dir(depthprint))


@pytest.mark.parametrize("name", all_modules())
def test_every_module_imports_and_its_all_exists(name: str) -> None:
    module = importlib.import_module(name)
    assert module.__doc__, f"{name} has no docstring"
    for public in getattr(module, "__all__", ()):
        assert hasattr(module, public), f"{name}.__all__ names {public!r}, which is not there"


@pytest.mark.parametrize("name", all_modules())
def test_every_public_module_states_its_names(name: str) -> None:
    module = importlib.import_module(name)
    path = Path(module.__file__ or "")
    if path.name == "__init__.py" or any(part.startswith("_") for part in name.split(".")):
        return
    assert hasattr(module, "__all__"), f"{name} has no __all__"


def test_the_package_is_marked_as_typed() -> None:
    assert (Path(depthprint.__file__).parent / "py.typed").is_file()


def constrained_names() -> set[str]:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    return {line.split("==")[0].lower() for line in lines if line and not line.startswith("#")}


def test_every_declared_dependency_is_pinned() -> None:
    text = (ROOT / "pyproject.toml").read_text()
    lists = re.findall(r"^(?:dependencies|zstd|hog|test|dev) = \[(.*?)\]", text, re.DOTALL | re.MULTILINE)
    asked = {name.lower() for block in lists for name in re.findall(r'"([A-Za-z][\w.-]*)', block)} - {
        "depthprint"
    }
    assert len(asked) > 10
    assert asked <= constrained_names()


def test_what_is_installed_is_what_is_pinned() -> None:
    from importlib import metadata

    from packaging.requirements import Requirement

    wrong = []
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        if not line or line.startswith("#"):
            continue
        pin = Requirement(line)
        if pin.marker is not None and not pin.marker.evaluate():
            continue
        try:
            version = metadata.version(pin.name)
        except metadata.PackageNotFoundError:
            continue
        if not pin.specifier.contains(version, prereleases=True):
            wrong.append(f"{pin.name} {version}, pinned {pin.specifier}")
    assert not wrong


@pytest.mark.parametrize(
    "page", ["README.md", "CONTRIBUTING.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))]
)
def test_links_between_pages_lead_somewhere(page: str) -> None:
    path = ROOT / page
    for target in re.findall(r"\]\(([^)#]+)\)", path.read_text()):
        if "://" not in target:
            assert (path.parent / target).exists(), f"{page} links to {target}"


def test_modules_stay_small() -> None:
    long = {
        str(path.relative_to(ROOT)): lines
        for path in (ROOT / "src").rglob("*.py")
        if (lines := len(path.read_text().splitlines())) > 400
    }
    assert not long
