"""Spatial pyramid of sparse codes: the codes that our signatures are made of, compared as one long vector."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder
from depthprint.encoding import Encoding
from depthprint.errors import SettingsError
from depthprint.range_image import RangeImage

__all__ = ["sparse_pyramid_features"]

Float32Array = npt.NDArray[np.float32]
Progress = Callable[[int, int], None]


def sparse_pyramid_features(
    encoder: Encoder, images: Sequence[RangeImage], progress: Progress | None = None
) -> tuple[Float32Array, Float32Array | None]:
    """Vectors (n, d) of views, and of their mirror images where the encoder mirrors views, else None.

    A stream's codes, max-pooled over all cells of its pyramid or one a column, are made a unit vector and weighed by
    the root of the stream's share, so that inner products are weighted means of the streams' cosines.
    Raises SettingsError for an encoder that does not pool codes over a grid, ModelError when it is not fitted.
    Source: Yang, Yu, Gong and Huang 2009; in the manner of Bo, Ren and Fox's hierarchical matching pursuit.
    """
    settings = encoder.settings
    if any(stream.clusters == "atoms" for stream in settings.streams):
        raise SettingsError(f"sparse pyramid: preset {settings.name!r} does not pool codes over a grid")
    shares = [np.float32(np.sqrt(weight)) for weight in settings.stream_weights]

    def row(encoding: Encoding) -> Float32Array:
        flat = [vectors.reshape(-1) for vectors in encoding.vectors]
        units = [vector / np.float32(max(float(np.linalg.norm(vector)), 1e-9)) for vector in flat]
        return np.concatenate([share * unit for share, unit in zip(shares, units, strict=True)])

    encodings = encoder.describe_many(images, progress)
    straight = np.stack([row(encoding) for encoding in encodings])
    if not settings.mirror:
        return straight, None
    return straight, np.stack([row(e.mirrored) for e in encodings if e.mirrored is not None])
