"""Encoders that lack a part: each lacks just that part, on simulated objects."""

from __future__ import annotations

import numpy as np
import pytest

from depthprint.encoder import load_shipped_encoder
from depthprint.encoder_ablations import UncodedEncoder, without_mirror, without_root
from depthprint.simulation.objects import simulated_objects
from depthprint.views import make_view


@pytest.fixture(scope="module")
def crop():
    objects = simulated_objects(n_categories=1, n_instances=1, frames=1, seed=4)
    return objects.read(objects.views[0])


@pytest.fixture(scope="module")
def encoder():
    return load_shipped_encoder("object")


def test_the_uncoded_encoder_keeps_the_views_as_they_are(encoder, crop):
    uncoded = UncodedEncoder(encoder.settings, encoder.streams).describe(crop)
    assert uncoded.signatures == ()
    for side, mirror in ((uncoded, False), (uncoded.mirrored, True)):
        for stream, rows in zip(encoder.settings.streams, side.vectors, strict=True):
            expected = make_view(crop, stream, encoder.settings, mirror).channels
            np.testing.assert_array_equal(rows, expected.reshape(1, -1))


def test_without_mirror_there_is_no_mirror_image_and_all_else_is_the_same(encoder, crop):
    whole, ablated = encoder.describe(crop), without_mirror(encoder).describe(crop)
    assert ablated.mirrored is None
    assert whole.mirrored is not None
    for one, other in zip(whole.vectors, ablated.vectors, strict=True):
        np.testing.assert_array_equal(one, other)


def test_without_root_large_coefficients_weigh_more(encoder, crop):
    rooted, plain = (e.describe(crop).vectors[0] for e in (encoder, without_root(encoder)))
    squares = rooted * np.abs(rooted)
    np.testing.assert_allclose(squares, plain, atol=1e-5 * np.abs(plain).max())
