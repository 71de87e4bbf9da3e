"""Encoders that lack one part of the shipped ones', to measure what that part is worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage
from depthprint.settings import EncoderSettings
from depthprint.views import View, make_views, mirrored_view

__all__ = [
    "UncodedEncoder",
    "random_patches",
    "suited_encoder",
    "without_coding",
    "without_mirror",
    "without_pairs",
    "without_root",
]


class UncodedEncoder(Encoder):
    """The views themselves, normals and relative depth, where the codes would be; there are no signatures."""

    def describe(self, image: RangeImage) -> Encoding:
        """The views as they are, as rows (1, c h w)."""
        views = list(make_views(image, self.settings))
        if not self.settings.mirror:
            return _uncoded(views)
        turned = [mirrored_view(v, stream) for v, stream in zip(views, self.settings.streams, strict=True)]
        return replace(_uncoded(views), mirrored=_uncoded(turned))


def _uncoded(views: Sequence[View]) -> Encoding:
    return Encoding((), tuple(view.channels.reshape(1, -1) for view in views))


def without_mirror(encoder: Encoder) -> Encoder:
    """The same dictionaries; views are not compared mirrored."""
    return Encoder(encoder.settings.model_copy(update={"mirror": False}), encoder.streams)


@lru_cache(maxsize=4)
def without_pairs(encoder: Encoder) -> Encoder:
    """The same streams but those of pairs of points; one encoder however often it is asked for."""
    if all(stream.view != "pairs" for stream in encoder.settings.streams):
        return encoder
    streams = zip(encoder.settings.streams, encoder.streams, strict=True)
    kept = [(settings, model) for settings, model in streams if settings.view != "pairs"]
    pictured = encoder.settings.model_copy(update={"streams": tuple(settings for settings, _ in kept)})
    return Encoder(pictured, tuple(model for _, model in kept))


def suited_encoder(encoder: Encoder, image: RangeImage) -> Encoder:
    """The encoder itself for a pinhole camera's images; for others without pairs, which it cannot see in them."""
    return encoder if isinstance(image.projection, Pinhole) else without_pairs(encoder)


def without_root(encoder: Encoder) -> Encoder:
    """The same dictionaries; coefficients are pooled as they are."""
    return Encoder(_with_streams(encoder.settings, root=False), encoder.streams)


def random_patches(encoder: Encoder) -> Encoder:
    """The same settings with training patches drawn at random for atoms, of the images that the preset learned from."""
    return _relearned(_with_streams(encoder.settings, dictionary="random"))


def without_coding(encoder: Encoder) -> Encoder:
    """The same settings with pixels for atoms: patches are pooled, and compared, as they are."""
    return _relearned(_with_streams(encoder.settings, dictionary="pixels"))


@lru_cache(maxsize=4)
def _relearned(settings: EncoderSettings) -> Encoder:
    from depthprint.simulation.training import training_images

    return Encoder(settings).fit(training_images(settings.name))


def _with_streams(settings: EncoderSettings, **changes: object) -> EncoderSettings:
    streams = tuple(stream.model_copy(update=changes) for stream in settings.streams)
    return settings.model_copy(update={"streams": streams})
