"""EncodedPlaces: what the recognisers over an encoder share, their descriptions being its encodings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.encoding_arrays import pack_encoding, unpack_encoding
from depthprint.range_image import RangeImage

__all__ = ["EncodedPlaces"]


class EncodedPlaces:
    """Base of recognisers whose descriptions are encodings: describes frames, and stores what it described."""

    def __init__(self, encoder: Encoder) -> None:
        self.encoder = encoder

    def describe(self, image: RangeImage) -> Encoding:
        """Encode one frame."""
        return self.encoder.describe(image)

    @property
    def fingerprint(self) -> str:
        """Fingerprint of the encoder."""
        return self.encoder.fingerprint

    def pack(self, description: Encoding) -> dict[str, npt.NDArray[Any]]:
        """Arrays of an encoding, for a place database."""
        return pack_encoding(description)

    def unpack(self, arrays: Mapping[str, npt.NDArray[Any]]) -> Encoding:
        """The encoding that ``pack`` took apart."""
        return unpack_encoding(arrays, self.encoder.fingerprint)
