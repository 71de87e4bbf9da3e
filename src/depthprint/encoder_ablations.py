"""Encoders that lack one part of the shipped ones', to measure what that part is worth."""

from __future__ import annotations

from functools import lru_cache

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.range_image import RangeImage
from depthprint.settings import EncoderSettings
from depthprint.views import make_view

__all__ = ["UncodedEncoder", "random_patches", "without_coding", "without_mirror", "without_root"]


class UncodedEncoder(Encoder):
    """The views themselves, normals and relative depth, where the codes would be; there are no signatures."""

    def _describe(self, image: RangeImage, mirror: bool) -> Encoding:
        vectors = tuple(
            make_view(image, stream, self.settings, mirror).channels.reshape(1, -1)
            for stream in self.settings.streams
        )
        return Encoding((), vectors)


def without_mirror(encoder: Encoder) -> Encoder:
    """The same dictionaries; views are not compared mirrored."""
    return Encoder(encoder.settings.model_copy(update={"mirror": False}), encoder.streams)


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
