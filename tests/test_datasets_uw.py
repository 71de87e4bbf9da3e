"""Objects in the UW RGB-D layout: a small tree of it, and cad51 where it is."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from depthprint.datasets import open_objects
from depthprint.datasets.uw_rgbd_object import read_category_trials, uw_rgbd_object
from depthprint.errors import DataError, SettingsError
from depthprint.io.depth_image import write_depth_png
from depthprint.io.mask_image import write_mask_image
from depthprint.projection import Pinhole

SIZE = (10, 14)


def write_view(root, category, instance, video, frame, left=201, top=101):
    folder = root / category / f"{category}_{instance}"
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder / f"{category}_{instance}_{video}_{frame}"
    depth_m = np.full(SIZE, 1.5)
    depth_m[3:7, 4:9] = 0.8
    write_depth_png(f"{stem}_depthcrop.png", depth_m)
    write_mask_image(f"{stem}_maskcrop.png", depth_m < 1)
    (folder / f"{stem.name}_loc.txt").write_text(f"{left},{top}\n")
    return folder


@pytest.fixture
def tree(tmp_path):
    """Two objects of each of two categories, three videos, frames 1, 6 and 11."""
    root = tmp_path / "rgbd-dataset"
    for category in ("apple", "food_bag"):
        for instance in (1, 2):
            for video in (1, 2, 4):
                for frame in (1, 6, 11):
                    write_view(root, category, instance, video, frame)
                    folder = root / category / f"{category}_{instance}"
                    (folder / f"{category}_{instance}_{video}_{frame}_crop.png").write_bytes(b"colour")
    return root


def test_views_are_parsed_from_names_with_underscores(tree):
    objects = open_objects(tree)
    assert (objects.name, objects.simulated) == ("uw_rgbd_object/rgbd-dataset", False)
    assert len(objects.views) == 36
    last = objects.views[-1]
    assert (last.category, last.instance, last.video, last.frame) == ("food_bag", "food_bag_2", 4, 11)
    assert objects.elevation_deg == {1: 30.0, 2: 45.0, 4: 60.0}


def test_crop_keeps_the_geometry_of_the_whole_image(tree):
    objects = open_objects(tree, focal_px=500.0, center_px=(319.5, 239.5))
    image = objects.read(objects.views[0])
    assert image.projection == Pinhole(500, 500, 319.5 - 200, 239.5 - 100, 14, 10)
    corner = image.points()[0, 0]
    np.testing.assert_allclose(corner, [(200 - 319.5) / 500 * 1.5, (100 - 239.5) / 500 * 1.5, 1.5], rtol=1e-5)


def test_mask_marks_the_object_and_the_ranges_around_it_stay(tree):
    objects = open_objects(tree)
    image = objects.read(objects.views[0])
    np.testing.assert_allclose(image.ranges_m[image.mask], 0.8)
    np.testing.assert_allclose(image.ranges_m[~image.mask], 1.5)
    assert image.mask.sum() == 20


def test_camera_is_the_published_one_then_the_files_then_the_options(tree):
    def camera(**options):
        objects = open_objects(tree, **options)
        return objects.read(objects.views[0]).projection

    published = camera()
    # The published centre (320, 240) and loc.txt (201, 101) both count from 1.
    assert (published.fx, published.cx, published.cy) == (570.3, 320 - 201, 240 - 101)
    (tree / "camera.json").write_text(json.dumps({"fx": 600, "cx": 300, "cy": 200, "simulated": True}))
    stated = camera()
    assert (stated.fx, stated.fy, stated.cx, stated.cy) == (600, 600, 100, 100)
    assert open_objects(tree).simulated
    assert camera(focal_px=555.0).fx == 555.0


def test_frames_and_every_select_views(tree):
    assert {v.frame for v in open_objects(tree, frames=[1, 11]).views} == {1, 11}
    write_view(tree, "apple", 1, 1, 3)
    assert {v.frame for v in open_objects(tree).views} == {1, 3, 6, 11}
    assert {v.frame for v in open_objects(tree, every=5).views} == {1, 6, 11}
    with pytest.raises(DataError, match="with the frames asked for, got none"):
        open_objects(tree, frames=[99])
    with pytest.raises(SettingsError, match="every"):
        open_objects(tree, every=0)


@pytest.mark.parametrize("part", ["maskcrop.png", "loc.txt"])
def test_view_without_mask_or_place_is_named(tree, part):
    (tree / "apple" / "apple_1" / f"apple_1_1_6_{part}").unlink()
    with pytest.raises(DataError, match=f"apple_1_1_6_{part}: missing"):
        open_objects(tree)


def test_misplaced_file_is_named(tree):
    source = tree / "apple" / "apple_1" / "apple_1_1_1_depthcrop.png"
    source.rename(tree / "apple" / "apple_2" / source.name)
    with pytest.raises(DataError, match=r"apple_1_1_1_depthcrop.png: expected a place and name"):
        open_objects(tree)


def test_unequal_mask_and_broken_place_are_named_when_read(tree):
    objects = open_objects(tree)
    folder = tree / "apple" / "apple_1"
    write_mask_image(folder / "apple_1_1_1_maskcrop.png", np.ones((3, 3), bool))
    with pytest.raises(DataError, match=r"apple_1_1_1_depthcrop.png: depth is \(10, 14\)"):
        objects.read(objects.views[0])
    for content in ("12", "a,b", "0,5"):
        (folder / "apple_1_1_6_loc.txt").write_text(content)
        with pytest.raises(DataError, match=r"apple_1_1_6_loc.txt: expected 'left,top'"):
            objects.read(objects.views[1])
    cv2.imwrite(str(folder / "apple_1_1_11_depthcrop.png"), np.zeros(SIZE, np.uint8))
    with pytest.raises(DataError, match=r"apple_1_1_11_depthcrop.png"):
        objects.read(objects.views[2])


def test_other_layouts_raise(tmp_path):
    with pytest.raises(DataError, match="no such folder"):
        uw_rgbd_object(tmp_path / "absent")
    with pytest.raises(DataError, match="got none"):
        uw_rgbd_object(tmp_path)
    with pytest.raises(SettingsError, match="focal_px"):
        uw_rgbd_object(tmp_path, focal_px=-1.0)


def test_published_trials_leave_out_one_object_of_each_category(tree):
    path = tree / "testinstance_ids.txt"
    path.write_text(
        "****** trial 1 ******\napple_2\nfood_bag_1\n\n****** trial 2 ******\napple_1\nfood_bag_2\n\n"
    )
    assert read_category_trials(path, open_objects(tree)) == (
        ("apple_2", "food_bag_1"),
        ("apple_1", "food_bag_2"),
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "empty"),
        ("apple_1\n", "trial 1"),
        ("*** trial 1 ***\n", "trial 1: expected instances, got none"),
        ("*** trial 1 ***\napple_9\n", "trial 1: 'apple_9' is no instance"),
        (
            "*** trial 1 ***\napple_1\n",
            "trial 1: expected one instance of each category, got 0 of 'food_bag'",
        ),
        ("*** trial 1 ***\napple_1\napple_2\nfood_bag_1\n", "got 2 of 'apple'"),
    ],
)
def test_malformed_trials_are_named(tree, content, message):
    path = tree / "testinstance_ids.txt"
    path.write_text(content)
    with pytest.raises(DataError, match=message):
        read_category_trials(path, open_objects(tree))


def test_cad51_is_never_called_real(data_root):
    objects = open_objects(data_root / "objects" / "cad51", frames=(1, 4, 7))
    assert objects.simulated
    assert "uw" not in objects.name
    assert len(objects.views) == 51 * 6 * 3 * 3
    assert len({v.instance for v in objects.views}) == 306
    image = objects.read(objects.views[100])
    assert image.projection.fx == 575.8
    assert 0 < image.mask.mean() < 1
