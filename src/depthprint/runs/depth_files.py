"""Single depth images as the user has them: a crop of an object with its mask, or any depth file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from depthprint.datasets.base import ObjectSet
from depthprint.errors import DataError
from depthprint.range_image import RangeImage

__all__ = ["LabelledFile", "labelled_files", "read_labelled", "read_view"]

_CROP = "_depthcrop.png"
_SUFFIXES = (".png", ".pgm", ".npy", ".npz")


@dataclass(frozen=True)
class LabelledFile:
    """A depth image and the class it is an example of."""

    path: Path
    label: str


def read_view(path: Path) -> RangeImage:
    """Read one depth image with what lies beside it.

    ``x_depthcrop.png`` in the UW RGB-D layout brings its mask and its place in the full image along; any other file
    takes its camera from ``camera.json`` in its folder, else a field of view like a Kinect's. Raises DataError naming
    the file.
    """
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    if path.name.endswith(_CROP):
        return _read_crop(path)
    from depthprint.datasets.frames import natural_order
    from depthprint.datasets.generic import generic

    # All files of its kind are named as the frames, so that a poses.txt beside them still fits; one is read.
    pattern = f"*{path.suffix}"
    order = natural_order(p for p in path.parent.glob(pattern) if p.is_file())
    return generic(path.parent, pattern=pattern)[order.index(path)]


def labelled_files(folder: Path) -> list[LabelledFile]:
    """Find the depth images of each class: one sub-folder a class, searched deeply, in the order of names.

    In the UW RGB-D layout the depth crops alone are taken. Raises DataError when there is no class.
    """
    if not folder.is_dir():
        raise DataError(f"{folder}: expected a folder with one sub-folder per class, got none")
    found = []
    for sub_folder in sorted(path for path in folder.iterdir() if path.is_dir()):
        files = sorted(p for p in sub_folder.rglob("*") if p.suffix.lower() in _SUFFIXES)
        crops = [path for path in files if path.name.endswith(_CROP)]
        found += [LabelledFile(path, sub_folder.name) for path in crops or files]
    if not found:
        raise DataError(f"{folder}: expected one sub-folder of depth images per class, found none")
    return found


def read_labelled(files: Sequence[LabelledFile], folder: Path) -> list[RangeImage]:
    """Read the files that ``labelled_files`` found in ``folder``."""
    if not any(file.path.name.endswith(_CROP) for file in files):
        return [read_view(file.path) for file in files]
    objects = _objects(folder)
    views = {Path(view.path).resolve(): view for view in objects.views}
    return [
        objects.read(views[path]) if (path := file.path.resolve()) in views else read_view(file.path)
        for file in files
    ]


def _read_crop(path: Path) -> RangeImage:
    root = path.resolve().parents[2] if len(path.resolve().parents) > 2 else path.parent
    objects = _objects(root)
    for view in objects.views:
        if Path(view.path).resolve() == path.resolve():
            return objects.read(view)
    raise DataError(f"{path}: expected a view in CATEGORY/CATEGORY_i/ as in the UW RGB-D layout")


def _objects(root: Path) -> ObjectSet:
    from depthprint.datasets.registry import open_objects

    return open_objects(root)
