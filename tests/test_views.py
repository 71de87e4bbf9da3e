"""Views: what is coded of an image."""

import numpy as np
import pytest

from depthprint.errors import DataError
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.settings import EncoderSettings, StreamSettings
from depthprint.views import make_view
from synthetic import CAMERA, boxes, crop


def view_of(image, name, **options):
    stream = StreamSettings(view=name, **options)
    return make_view(image, stream, EncoderSettings(name="t", streams=(stream,)))


def plane(slope: float) -> RangeImage:
    """A plane z = 3 / (1 - slope * x/z): its normal is (slope, 0, -1), normalised, in the camera frame."""
    u = (np.arange(128) - 63.5) / 80.0
    z = np.broadcast_to(3.0 / (1.0 - slope * u), (96, 128))
    return RangeImage(z.astype(np.float32), CAMERA)


@pytest.mark.parametrize("slope", [-0.4, 0.0, 0.4])
def test_normals_of_a_slanted_plane_have_its_slope(slope):
    channels = view_of(plane(slope), "normals").channels[:, 8:-8, 8:-8]
    nx, ny, nz = channels.mean((1, 2))
    assert np.allclose(ny, 0, atol=0.02)
    assert np.sign(nx) == np.sign(slope)
    assert np.allclose(np.abs(nx / nz), np.abs(slope), atol=0.12)


def test_normals_are_unit_vectors_on_the_support():
    view = view_of(boxes(0), "normals", smoothing=1.0)
    norms = np.linalg.norm(view.channels, axis=0)
    assert norms.max() <= 1 + 1e-5
    assert np.median(norms[view.support]) > 0.9


def test_relative_depth_does_not_change_with_the_scale_of_an_object_seen_from_afar():
    image = crop(1)
    far = RangeImage(image.ranges_m * 2, image.projection, mask=image.mask)
    near_view, far_view = view_of(image, "depth"), view_of(far, "depth")
    assert np.allclose(near_view.channels, far_view.channels, atol=1e-4)


def test_nothing_outside_the_mask_is_coded():
    view = view_of(crop(2), "depth")
    assert not view.channels[:, ~view.support].any()
    assert view.support.any()
    assert not view.support.all()


@pytest.mark.parametrize("name", ["depth", "normals", "raw-depth"])
def test_mirrored_view_is_the_view_of_the_mirrored_object(name):
    image = crop(3)
    mirrored = RangeImage(image.ranges_m[:, ::-1], image.projection, mask=image.mask[:, ::-1])
    stream = StreamSettings(view=name)
    settings = EncoderSettings(name="t", streams=(stream,))
    expected = make_view(mirrored, stream, settings).channels
    got = make_view(image, stream, settings, mirror=True).channels
    assert np.abs(expected - got).mean() < 0.03


def test_an_image_without_returns_is_an_error_that_names_it():
    empty = RangeImage(np.full((4, 4), np.nan, np.float32), Pinhole(4, 4, 2, 2, 4, 4), source="frame 7")
    with pytest.raises(DataError, match="frame 7"):
        view_of(empty, "depth")
