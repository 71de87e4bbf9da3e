"""UW RGB-D Object layout: masked depth crops of objects on a turntable, seen from three elevations."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

import numpy as np

from depthprint.datasets.base import ObjectSet, ObjectView
from depthprint.datasets.camera_file import read_camera_file
from depthprint.errors import DataError, SettingsError
from depthprint.io.depth_image import read_depth_image
from depthprint.io.mask_image import read_mask_image
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage

__all__ = ["cad51", "read_category_trials", "uw_rgbd_object"]

ELEVATION_DEG = {1: 30.0, 2: 45.0, 4: 60.0}
CROP_NAME = re.compile(r"(?P<instance>(?P<category>.+)_\d+)_(?P<video>\d+)_(?P<frame>\d+)_depthcrop\.png")
TRIAL_TITLE = re.compile(r"\*+\s*trial\s+\d+\s*\**", re.IGNORECASE)

# The published centre is (320, 240) counted from 1, as loc.txt is; pixels are counted from 0 here.
UW_FOCAL_PX, UW_CENTER_PX = 570.3, (319.0, 239.0)
CAD51_FOCAL_PX, CAD51_CENTER_PX = 575.8, (319.5, 239.5)


def uw_rgbd_object(
    root: Path | str,
    *,
    frames: Collection[int] | None = None,
    every: int = 1,
    focal_px: float | None = None,
    center_px: tuple[float, float] | None = None,
    name: str | None = None,
    simulated: bool | None = None,
) -> ObjectSet:
    """Read ``CAT/CAT_i/CAT_i_VIDEO_FRAME_{depthcrop.png,maskcrop.png,loc.txt}`` (depth 16 bit, mm).

    frames: frame numbers to take of each video, None for all. every: of the frame numbers 1, 2, 3, ... take
        each n-th, the first included; 5 gives the published evaluation subset out of the full set.
    focal_px, center_px: camera of the uncropped images, pixels counted from 0. Left out, they come from a
        ``camera.json`` {fx, fy, cx, cy, simulated} in ``root``, else from the published set: 570.3, (319,
        239).
    A view is a pinhole image cropped as its loc.txt (left, top, counted from 1) says; its mask marks the
    object and the ranges around it stay. Videos 1, 2 and 4 look from 30, 45 and 60 degrees.
    Raises DataError for a folder without views, misnamed files, and views that lack their mask or place;
    SettingsError for options out of range. Source: Lai et al., ICRA 2011.
    """
    root = Path(root)
    fx, fy, cx, cy, stated_simulated = _camera(root, focal_px, center_px)
    views = _views(root, None if frames is None else frozenset(frames), every)

    def read(view: ObjectView) -> RangeImage:
        path = Path(view.path)
        ranges_m = read_depth_image(path, 0.001)
        mask = read_mask_image(_beside(path, "maskcrop.png"))
        if mask.shape != ranges_m.shape:
            raise DataError(f"{path}: depth is {ranges_m.shape} but its mask is {mask.shape} pixels")
        left, top = _read_location(_beside(path, "loc.txt"))
        height, width = ranges_m.shape
        camera = Pinhole(fx, fy, cx - (left - 1), cy - (top - 1), width, height)
        return RangeImage(ranges_m, camera, mask=mask, source=str(path))

    return ObjectSet(
        name=f"uw_rgbd_object/{root.resolve().name}" if name is None else name,
        views=views,
        read=read,
        elevation_deg=dict(ELEVATION_DEG),
        simulated=stated_simulated if simulated is None else simulated,
    )


def cad51(root: Path | str, *, frames: Collection[int] | None = None, every: int = 1) -> ObjectSet:
    """Read cad51, rendered CAD objects in the UW layout: simulated, with a camera of its own."""
    return uw_rgbd_object(
        root,
        frames=frames,
        every=every,
        focal_px=CAD51_FOCAL_PX,
        center_px=CAD51_CENTER_PX,
        name="cad51 (simulated)",
        simulated=True,
    )


def read_category_trials(path: Path | str, objects: ObjectSet | None = None) -> tuple[tuple[str, ...], ...]:
    """Read testinstance_ids.txt: for each published trial, the instances left out, one of each category.

    objects: where given, each trial must name one of its instances for each of its categories.
    Raises DataError naming the file and the trial.
    """
    path = Path(path)
    try:
        lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error
    trials: list[list[str]] = []
    for line in filter(None, lines):
        if TRIAL_TITLE.fullmatch(line):
            trials.append([])
        elif not trials:
            raise DataError(f"{path}: expected a line '*** trial 1 ***' first, got {line[:40]!r}")
        else:
            trials[-1].append(line)
    if not trials:
        raise DataError(f"{path}: expected trials, got an empty file")
    for number, trial in enumerate(trials, start=1):
        _check_trial(f"{path}: trial {number}", trial, objects)
    return tuple(tuple(trial) for trial in trials)


def has_views(root: Path) -> bool:
    """Whether a folder holds views in this layout."""
    return next(root.glob("*/*/*_depthcrop.png"), None) is not None


def _camera(
    root: Path, focal_px: float | None, center_px: tuple[float, float] | None
) -> tuple[float, float, float, float, bool]:
    fx, fy, (cx, cy) = UW_FOCAL_PX, UW_FOCAL_PX, UW_CENTER_PX
    simulated = False
    file = root / "camera.json"
    if file.is_file():
        stated = read_camera_file(file)
        fx = fx if stated.fx is None else stated.fx
        fy = fx if stated.fy is None else stated.fy
        cx = cx if stated.cx is None else stated.cx
        cy = cy if stated.cy is None else stated.cy
        simulated = stated.simulated
    if focal_px is not None:
        if not (np.isfinite(focal_px) and focal_px > 0):
            raise SettingsError(f"focal_px: expected a positive number, got {focal_px}")
        fx = fy = float(focal_px)
    if center_px is not None:
        cx, cy = (float(c) for c in center_px)
    return fx, fy, cx, cy, simulated


def _views(root: Path, frames: frozenset[int] | None, every: int) -> tuple[ObjectView, ...]:
    if not root.is_dir():
        raise DataError(f"{root}: expected a folder of categories, got no such folder")
    if not isinstance(every, int) or every < 1:
        raise SettingsError(f"every: expected a whole number >= 1, got {every!r}")
    views = []
    for folder in sorted(p for p in root.glob("*/*") if p.is_dir()):
        names = {p.name for p in folder.iterdir()}
        for name in sorted(n for n in names if n.endswith("_depthcrop.png")):
            view = _view(folder, name)
            if (frames is None or view.frame in frames) and (view.frame - 1) % every == 0:
                for part in ("maskcrop.png", "loc.txt"):
                    if (wanted := name.replace("depthcrop.png", part)) not in names:
                        raise DataError(
                            f"{folder / wanted}: missing; each depthcrop needs its mask and place"
                        )
                views.append(view)
    if not views:
        chosen = "" if frames is None and every == 1 else " with the frames asked for"
        raise DataError(f"{root}: expected CAT/CAT_1/CAT_1_1_1_depthcrop.png and so on{chosen}, got none")
    return tuple(sorted(views, key=lambda v: (v.category, _number(v.instance), v.video, v.frame)))


def _view(folder: Path, name: str) -> ObjectView:
    match = CROP_NAME.fullmatch(name)
    if not match or match["instance"] != folder.name or match["category"] != folder.parent.name:
        raise DataError(
            f"{folder / name}: expected a place and name like mug/mug_1/mug_1_2_17_depthcrop.png "
            "(category, instance, video, frame)"
        )
    return ObjectView(
        match["category"], match["instance"], int(match["video"]), int(match["frame"]), str(folder / name)
    )


def _number(instance: str) -> int:
    return int(instance.rpartition("_")[2])


def _beside(depth: Path, part: str) -> Path:
    return depth.with_name(depth.name.replace("depthcrop.png", part))


def _read_location(path: Path) -> tuple[int, int]:
    try:
        left, top = (int(v) for v in path.read_text(encoding="utf-8").replace(",", " ").split())
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: expected 'left,top' in whole pixels counted from 1, got {error}") from error
    if min(left, top) < 1:
        raise DataError(f"{path}: expected 'left,top' counted from 1, got {left},{top}")
    return left, top


def _check_trial(where: str, trial: list[str], objects: ObjectSet | None) -> None:
    if not trial:
        raise DataError(f"{where}: expected instances, got none")
    if objects is None:
        return
    category_of = {view.instance: view.category for view in objects.views}
    unknown = [instance for instance in trial if instance not in category_of]
    if unknown:
        raise DataError(f"{where}: {unknown[0]!r} is no instance of {objects.name}")
    named = [category_of[instance] for instance in trial]
    lacking = sorted(set(category_of.values()) - set(named))
    if lacking or len(set(named)) != len(named):
        odd = lacking[0] if lacking else next(c for c in named if named.count(c) > 1)
        raise DataError(f"{where}: expected one instance of each category, got {named.count(odd)} of {odd!r}")
