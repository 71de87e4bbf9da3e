"""An encoding as named arrays, for files and databases, and back again bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.encoding import Encoding
from depthprint.errors import DataError
from depthprint.signature import Signature

__all__ = ["pack_encoding", "unpack_encoding"]

_MIRRORED = "mirrored_"


def pack_encoding(encoding: Encoding) -> dict[str, npt.NDArray[Any]]:
    """Arrays ``weights_s`` (k,), ``points_s`` (k, d), ``vectors_s`` (m, a) of each stream s.

    Those of a mirrored encoding follow, their names led by ``mirrored_``. The fingerprint is not among them.
    """
    arrays: dict[str, npt.NDArray[Any]] = {}
    for stream, (signature, vectors) in enumerate(zip(encoding.signatures, encoding.vectors, strict=True)):
        arrays[f"weights_{stream}"] = signature.weights
        arrays[f"points_{stream}"] = signature.points
        arrays[f"vectors_{stream}"] = vectors
    if encoding.mirrored is not None:
        for name, array in pack_encoding(encoding.mirrored).items():
            arrays[_MIRRORED + name] = array
    return arrays


def unpack_encoding(arrays: Mapping[str, npt.NDArray[Any]], fingerprint: str) -> Encoding:
    """The encoding that ``pack_encoding`` took apart; arrays of other names are left alone.

    Raises DataError when an array is missing or of another shape.
    """
    signatures: list[Signature] = []
    vectors: list[npt.NDArray[np.float32]] = []
    while f"weights_{len(signatures)}" in arrays:
        stream = len(signatures)
        missing = [name for name in (f"points_{stream}", f"vectors_{stream}") if name not in arrays]
        if missing:
            raise DataError(f"encoding: expected an array {missing[0]!r}, got {', '.join(sorted(arrays))}")
        signatures.append(Signature(arrays[f"weights_{stream}"], arrays[f"points_{stream}"], fingerprint))
        vectors.append(np.asarray(arrays[f"vectors_{stream}"], dtype=np.float32))
    if not signatures:
        names = ", ".join(sorted(arrays)) or "none"
        raise DataError(f"encoding: expected an array 'weights_0', got {names}")
    mirrored = {name[len(_MIRRORED) :]: a for name, a in arrays.items() if name.startswith(_MIRRORED)}
    return Encoding(
        tuple(signatures), tuple(vectors), unpack_encoding(mirrored, fingerprint) if mirrored else None
    )
