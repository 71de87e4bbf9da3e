"""Recognise places and objects from depth alone, by the information complexity of sparse models.

The way of the data, with the equations of Norouzzadeh Ravari and Taghirad (2015) that each part carries out::

    range_image          metric depth with its projection; NaN is "no return"
      -> views           what is coded: depth, normals, or a bird's-eye height map
      -> dictionary      atoms learned from depth                          eq. 1-2
      -> sparse_coding   orthogonal matching pursuit                       eq. 3-7
      -> signature       weighted points in a ground space                 eq. 9-10
      -> emd             exact earth mover's distance                      eq. 11-16
      -> complexity      K(X|Y) and K(X) by the EMD, or by a compressor    eq. 17-18
      -> ncd             normalised information distance                   eq. 8
      -> classification  class of the nearest object
       / loop_closure    a place seen before, below a threshold

`Encoder` is the part from a range image to its signatures; `NearestComplexityClassifier` and
`LoopClosureDetector` are its two uses. Names below are imported when first asked for, so that
``import depthprint`` costs little.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from depthprint._version import __version__

if TYPE_CHECKING:
    from depthprint.cascade.assembly import make_cascade
    from depthprint.cascade.settings import CascadeSettings
    from depthprint.cascade.verified_recognizer import VerifiedRecognizer
    from depthprint.classification import NearestComplexityClassifier
    from depthprint.datasets.base import LoopTruth, ObjectSet, ObjectView, RangeSequence
    from depthprint.datasets.registry import open_objects, open_sequence
    from depthprint.dictionary import Dictionary
    from depthprint.dictionary_learning import learn_dictionary
    from depthprint.emd import EMDResult, difference_matrix
    from depthprint.encoder import Encoder, load_shipped_encoder
    from depthprint.errors import (
        ConvergenceError,
        DataError,
        DepthprintError,
        FingerprintError,
        MissingExtraError,
        ModelError,
        SettingsError,
    )
    from depthprint.loop_closure import LoopClosureDetector
    from depthprint.loop_status import LoopResult, LoopStatus
    from depthprint.objects.methods import make_object_method
    from depthprint.objects.trained_recogniser import Recognition, TrainedRecogniser
    from depthprint.place_database import PlaceDatabase
    from depthprint.place_methods import make_place_recognizer
    from depthprint.projection import LaserRow, Pinhole, Projection, Spherical
    from depthprint.range_image import RangeImage
    from depthprint.recognizer import PlaceMatch, PlaceRecognizer
    from depthprint.resampling import resample
    from depthprint.signature import GroundDistance, Signature, SignatureBatch
    from depthprint.signature_index import SignatureIndex, StreamDistance
    from depthprint.sparse_coding import SparseModel, sparse_code
    from depthprint.verification import GeometricVerifier, Verification, make_depth_view

__all__ = [
    "CascadeSettings",
    "ConvergenceError",
    "DataError",
    "DepthprintError",
    "Dictionary",
    "EMDResult",
    "Encoder",
    "FingerprintError",
    "GeometricVerifier",
    "GroundDistance",
    "LaserRow",
    "LoopClosureDetector",
    "LoopResult",
    "LoopStatus",
    "LoopTruth",
    "MissingExtraError",
    "ModelError",
    "NearestComplexityClassifier",
    "ObjectSet",
    "ObjectView",
    "Pinhole",
    "PlaceDatabase",
    "PlaceMatch",
    "PlaceRecognizer",
    "Projection",
    "RangeImage",
    "RangeSequence",
    "Recognition",
    "SettingsError",
    "Signature",
    "SignatureBatch",
    "SignatureIndex",
    "SparseModel",
    "Spherical",
    "StreamDistance",
    "TrainedRecogniser",
    "Verification",
    "VerifiedRecognizer",
    "__version__",
    "difference_matrix",
    "learn_dictionary",
    "load_shipped_encoder",
    "make_cascade",
    "make_depth_view",
    "make_object_method",
    "make_place_recognizer",
    "open_objects",
    "open_sequence",
    "resample",
    "sparse_code",
]

_HOMES = {
    "depthprint.classification": ("NearestComplexityClassifier",),
    "depthprint.datasets.base": ("LoopTruth", "ObjectSet", "ObjectView", "RangeSequence"),
    "depthprint.datasets.registry": ("open_objects", "open_sequence"),
    "depthprint.dictionary": ("Dictionary",),
    "depthprint.dictionary_learning": ("learn_dictionary",),
    "depthprint.emd": ("EMDResult", "difference_matrix"),
    "depthprint.encoder": ("Encoder", "load_shipped_encoder"),
    "depthprint.errors": (
        "ConvergenceError",
        "DataError",
        "DepthprintError",
        "FingerprintError",
        "MissingExtraError",
        "ModelError",
        "SettingsError",
    ),
    "depthprint.cascade.assembly": ("make_cascade",),
    "depthprint.cascade.settings": ("CascadeSettings",),
    "depthprint.loop_closure": ("LoopClosureDetector",),
    "depthprint.loop_status": ("LoopResult", "LoopStatus"),
    "depthprint.objects.methods": ("make_object_method",),
    "depthprint.place_database": ("PlaceDatabase",),
    "depthprint.place_methods": ("make_place_recognizer",),
    "depthprint.projection": ("LaserRow", "Pinhole", "Projection", "Spherical"),
    "depthprint.range_image": ("RangeImage",),
    "depthprint.recognizer": ("PlaceMatch", "PlaceRecognizer"),
    "depthprint.resampling": ("resample",),
    "depthprint.signature": ("GroundDistance", "Signature", "SignatureBatch"),
    "depthprint.signature_index": ("SignatureIndex", "StreamDistance"),
    "depthprint.sparse_coding": ("SparseModel", "sparse_code"),
    "depthprint.verification": ("GeometricVerifier", "Verification", "make_depth_view"),
    "depthprint.cascade.verified_recognizer": ("VerifiedRecognizer",),
    "depthprint.objects.trained_recogniser": ("Recognition", "TrainedRecogniser"),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    try:
        module = _HOME_OF[name]
    except KeyError:
        raise AttributeError(f"module 'depthprint' has no attribute {name!r}") from None
    value = getattr(importlib.import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
