"""Semi-global matching on pairs whose disparity is known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.errors import DataError, SettingsError
from depthprint.stereo_matching import SemiGlobalMatching, sgbm_depth

FOCAL_PX, BASELINE_M = 700.0, 0.5


def pair_with_disparity(disparity_px: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Right image of random texture; each left pixel looks up its match, so the disparity is exact."""
    height, width = disparity_px.shape
    rng = np.random.default_rng(seed)
    texture = rng.integers(20, 235, (height, width)).astype(np.float64)
    texture = (texture + np.roll(texture, 1, axis=1)) / 2
    columns = np.arange(width)
    left = np.stack(
        [np.interp(columns - d, columns, row) for d, row in zip(disparity_px, texture, strict=True)]
    )
    return left.astype(np.uint8), texture.astype(np.uint8)


def test_metric_depth_of_two_walls():
    disparity = np.full((80, 240), 10.0)
    disparity[40:] = 35.0
    left, right = pair_with_disparity(disparity)
    depth = sgbm_depth(left, right, focal_px=FOCAL_PX, baseline_m=BASELINE_M)
    assert depth.dtype == np.float32
    for rows, d in ((slice(5, 35), 10.0), (slice(45, 75), 35.0)):
        seen = depth[rows, 40:-5]
        assert np.isfinite(seen).mean() > 0.95
        np.testing.assert_allclose(np.nanmedian(seen), FOCAL_PX * BASELINE_M / d, rtol=0.01)


def test_columns_near_the_left_edge_are_measured_where_both_cameras_see_them():
    left, right = pair_with_disparity(np.full((80, 240), 20.0))
    depth = sgbm_depth(left, right, focal_px=FOCAL_PX, baseline_m=BASELINE_M)
    assert np.isfinite(depth[5:-5, 25:120]).mean() > 0.95
    assert np.isnan(depth[:, :15]).all()


def test_depth_beyond_the_limit_is_no_return():
    left, right = pair_with_disparity(np.full((80, 240), 7.0))
    near = SemiGlobalMatching(max_depth_m=45.0)
    depth = sgbm_depth(left, right, focal_px=FOCAL_PX, baseline_m=BASELINE_M, settings=near)
    assert np.isnan(depth[5:-5, 20:-5]).mean() > 0.95
    assert not (depth > 45.0).any()


def test_images_without_texture_give_no_return_rather_than_a_guess():
    flat = np.full((80, 240), 128, dtype=np.uint8)
    assert np.isnan(sgbm_depth(flat, flat, focal_px=FOCAL_PX, baseline_m=BASELINE_M)).all()


@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        (np.zeros((8, 9), np.uint8), np.zeros((8, 8), np.uint8), r"000007: left image is \(8, 9\)"),
        (np.zeros((8, 9), np.float32), np.zeros((8, 9), np.uint8), "grey uint8 left image, got float32"),
        (np.zeros((8, 9), np.uint8), np.zeros((8, 9, 3), np.uint8), "grey uint8 right image"),
        (np.zeros((4, 9), np.uint8), np.zeros((4, 9), np.uint8), "smaller than the block"),
        (np.zeros((0, 0), np.uint8), np.zeros((0, 0), np.uint8), "smaller than the block"),
    ],
)
def test_unfit_images_are_named(left, right, message):
    with pytest.raises(DataError, match=message):
        sgbm_depth(left, right, focal_px=1.0, baseline_m=1.0, source="000007")


def test_images_narrower_than_the_search_are_matched_all_the_same():
    left, right = pair_with_disparity(np.full((40, 60), 8.0))
    depth = sgbm_depth(left, right, focal_px=FOCAL_PX, baseline_m=BASELINE_M)
    np.testing.assert_allclose(np.nanmedian(depth), FOCAL_PX * BASELINE_M / 8, rtol=0.01)


@pytest.mark.parametrize("values", [{"focal_px": 0.0}, {"baseline_m": -0.5}, {"focal_px": np.nan}])
def test_unfit_camera_raises(values):
    image = np.zeros((8, 9), np.uint8)
    with pytest.raises(SettingsError):
        sgbm_depth(image, image, **{"focal_px": 1.0, "baseline_m": 1.0, **values})


@pytest.mark.parametrize(
    "settings",
    [{"max_disparity_px": 100}, {"block_size_px": 4}, {"uniqueness_percent": -1}, {"max_depth_m": 0.0}],
)
def test_unfit_settings_raise(settings):
    with pytest.raises(SettingsError):
        SemiGlobalMatching(**settings)
