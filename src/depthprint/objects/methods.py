"""The registry of methods that name objects: ours, its ablations and the baselines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthprint.encoder import Encoder, load_shipped_encoder
from depthprint.encoder_ablations import (
    UncodedEncoder,
    random_patches,
    without_mirror,
    without_pairs,
    without_root,
)
from depthprint.errors import ModelError, SettingsError
from depthprint.evaluation.object_methods import ObjectMethod, PrecomputedDistanceMethod
from depthprint.objects.comparisons import ObjectComparisons
from depthprint.objects.distances import compression_distances, pixel_distances
from depthprint.objects.surface_comparisons import SurfaceComparisons
from depthprint.range_image import RangeImage

if TYPE_CHECKING:
    from depthprint.objects.linear_methods import LinearSvmMethod

__all__ = ["LOCAL_SCALING", "OBJECT_METHODS", "make_object_method", "make_object_methods", "table_methods"]

Progress = Callable[[int, int], None]

# Every nearest-neighbour method, ours or not, has its distances scaled by those to the 10th neighbour.
LOCAL_SCALING = 10

# Weights of the errors of the linear machines. The kernel descriptors' is their authors', the others were chosen by
# nested splits of training objects, where ten times more or less made little difference.
KDES_C = 10.0
HOG_C = 3.0
SPARSE_PYRAMID_C = 10.0
# Of the agreement of alignments beside these machines' margins, chosen as the recogniser's was.
LINEAR_AGREEMENT_WEIGHT = 6.6

# What the kernels and neighbours of rows that are the recogniser but for these are made of.
_PARTS = {
    "no-emd": ("codes", "surfaces", "pairs"),
    "no-pairs": ("codes", "complexities", "surfaces"),
    "no-kdes": ("codes", "complexities", "pairs"),
    "no-surfaces": ("codes", "complexities"),
    "no-size": ("codes", "complexities", "sizeless", "pairs"),
    "no-codes": ("surfaces", "pairs"),
    "only-codes": ("codes",),
    "only-pairs": ("pairs",),
    "with-turned": ("codes", "complexities", "turned"),
}

# Asked for by name only: compressors that say no more than the others do, and turned copies, which cost as much again.
NOT_IN_TABLE = ("ncd-lzma", "ncd-zstd", "with-turned", "kdes-all-aided-turned")


def _nearest(name: str, encoder: Encoder, kind: str) -> ObjectMethod:
    from depthprint.objects.encoded_methods import EncodedNearest

    return EncodedNearest(name, ObjectComparisons(encoder), kind, LOCAL_SCALING)


def _emd(name: str, encoder: Encoder) -> ObjectMethod:
    return _nearest(name, encoder, "complexities")


def _emd_no_pairs(name: str, encoder: Encoder) -> ObjectMethod:
    return _emd(name, without_pairs(encoder))


def _emd_literal(name: str, encoder: Encoder) -> ObjectMethod:
    return _nearest(name, load_shipped_encoder("literal"), "complexities")


def _emd_svm(name: str, encoder: Encoder) -> ObjectMethod:
    from depthprint.objects.encoded_methods import EncodedSVM

    return EncodedSVM(name, ObjectComparisons(encoder))


def _fused(name: str, encoder: Encoder, parts: Sequence[str] | None = None) -> ObjectMethod:
    from depthprint.objects.encoded_methods import ALL_PARTS, EncodedRecogniser

    return EncodedRecogniser(name, ObjectComparisons(encoder), parts=ALL_PARTS if parts is None else parts)


def _recogniser(name: str, encoder: Encoder) -> ObjectMethod:
    from depthprint.objects.alignment import AGREEMENT_WEIGHT
    from depthprint.objects.encoded_methods import EncodedRecogniser
    from depthprint.objects.geometry_checked import GeometryChecked

    return GeometryChecked(name, EncodedRecogniser(name, ObjectComparisons(encoder)), AGREEMENT_WEIGHT)


def _saved(name: str, encoder: Encoder) -> ObjectMethod:
    from depthprint.objects.saved_method import SavedRecogniserMethod

    return SavedRecogniserMethod(name, encoder)


def _no_geometry(name: str, encoder: Encoder) -> ObjectMethod:
    return _fused(name, encoder)


def _fused_of_parts(name: str, encoder: Encoder) -> ObjectMethod:
    parts = _PARTS[name]
    return _fused(name, encoder if "pairs" in parts else without_pairs(encoder), parts)


def _no_partial(name: str, encoder: Encoder) -> ObjectMethod:
    from depthprint.objects.encoded_methods import EncodedRecogniser

    return EncodedRecogniser(name, ObjectComparisons(encoder), partial=False)


def _no_mirror(name: str, encoder: Encoder) -> ObjectMethod:
    return _fused(name, without_mirror(encoder))


def _no_root(name: str, encoder: Encoder) -> ObjectMethod:
    return _fused(name, without_root(encoder))


def _random_patches(name: str, encoder: Encoder) -> ObjectMethod:
    return _fused(name, random_patches(encoder))


def _no_coding(name: str, encoder: Encoder) -> ObjectMethod:
    return _fused(name, UncodedEncoder(encoder.settings, encoder.streams), _PARTS["no-emd"])


def _relaxed(name: str, encoder: Encoder) -> ObjectMethod:
    return _nearest(name, encoder, "relaxed")


def _cosine(name: str, encoder: Encoder) -> ObjectMethod:
    return _nearest(name, encoder, "codes")


def _pixel_l2(name: str, encoder: Encoder) -> ObjectMethod:
    return PrecomputedDistanceMethod(
        lambda images, _: pixel_distances(images), name, local_scaling=LOCAL_SCALING
    )


def _compression(name: str, encoder: Encoder) -> ObjectMethod:
    def distances(images: Sequence[RangeImage], progress: Progress | None) -> npt.NDArray[np.float64]:
        return compression_distances(images, name.removeprefix("ncd-"), progress)

    return PrecomputedDistanceMethod(distances, name, local_scaling=LOCAL_SCALING)


def _kernel_descriptors(name: str, encoder: Encoder) -> LinearSvmMethod:
    from depthprint.baselines.kernel_descriptors.kinds import KINDS
    from depthprint.objects.linear_methods import KernelDescriptorViews, LinearSvmMethod

    kind, *options = name.removeprefix("kdes-").split("-")
    aided = "aided" in options
    features = KernelDescriptorViews(
        tuple(KINDS) if kind == "all" else (kind,),
        mirror=aided,
        masked=aided,
        turned="turned" in options,
        seed=encoder.settings.seed,
    )
    return LinearSvmMethod(name, features, C=KDES_C)


def _checked_kernel_descriptors(name: str, encoder: Encoder) -> ObjectMethod:
    from depthprint.objects.geometry_checked import GeometryChecked

    return GeometryChecked(name, _kernel_descriptors(name, encoder), LINEAR_AGREEMENT_WEIGHT)


def _hog(name: str, encoder: Encoder) -> ObjectMethod:
    from depthprint.baselines.hog import hog_features
    from depthprint.objects.linear_methods import FixedFeatures, LinearSvmMethod

    return LinearSvmMethod(name, FixedFeatures(hog_features), C=HOG_C)


def _sparse_pyramid(name: str, encoder: Encoder) -> ObjectMethod:
    return _codes_svm(name, without_pairs(encoder))


def _checked_codes_svm(name: str, encoder: Encoder) -> ObjectMethod:
    from depthprint.objects.geometry_checked import GeometryChecked

    return GeometryChecked(name, _codes_svm(name, encoder), LINEAR_AGREEMENT_WEIGHT)


def _codes_svm(name: str, encoder: Encoder) -> LinearSvmMethod:
    from depthprint.baselines.sparse_pyramid import sparse_pyramid_features
    from depthprint.objects.linear_methods import FixedFeatures, LinearSvmMethod

    features = FixedFeatures(lambda images, progress: sparse_pyramid_features(encoder, images, progress))
    return LinearSvmMethod(name, features, C=SPARSE_PYRAMID_C)


OBJECT_METHODS: dict[str, Callable[[str, Encoder], ObjectMethod]] = {
    "recogniser": _recogniser,
    "recogniser-saved": _saved,
    "no-geometry": _no_geometry,
    "emd": _emd,
    "emd-no-pairs": _emd_no_pairs,
    "emd-svm": _emd_svm,
    "emd-literal": _emd_literal,
    "no-emd": _fused_of_parts,
    "no-surfaces": _fused_of_parts,
    "no-kdes": _fused_of_parts,
    "no-size": _fused_of_parts,
    "no-pairs": _fused_of_parts,
    "no-codes": _fused_of_parts,
    "only-pairs": _fused_of_parts,
    "only-codes": _fused_of_parts,
    "no-partial": _no_partial,
    "with-turned": _fused_of_parts,
    "no-coding": _no_coding,
    "random-patches": _random_patches,
    "no-mirror": _no_mirror,
    "no-root": _no_root,
    "relaxed": _relaxed,
    "cosine": _cosine,
    "pixel-l2": _pixel_l2,
    "ncd-gzip": _compression,
    "ncd-bz2": _compression,
    "ncd-ppm": _compression,
    "ncd-lzma": _compression,
    "ncd-zstd": _compression,
    "kdes-gradient": _kernel_descriptors,
    "kdes-lbp": _kernel_descriptors,
    "kdes-spin": _kernel_descriptors,
    "kdes-size": _kernel_descriptors,
    "kdes-all": _kernel_descriptors,
    "kdes-gradient-aided": _kernel_descriptors,
    "kdes-lbp-aided": _kernel_descriptors,
    "kdes-spin-aided": _kernel_descriptors,
    "kdes-size-aided": _kernel_descriptors,
    "kdes-all-aided": _kernel_descriptors,
    "kdes-all-aided-turned": _kernel_descriptors,
    "kdes-all-aided-geometry": _checked_kernel_descriptors,
    "hog-svm": _hog,
    "sparse-pyramid-svm": _sparse_pyramid,
    "codes-svm": _codes_svm,
    "codes-svm-geometry": _checked_codes_svm,
}


def table_methods() -> list[str]:
    """The rows of the paper's second table, and what they are best compared with: all that one run measures."""
    return [name for name in OBJECT_METHODS if name not in NOT_IN_TABLE]


def make_object_method(name: str, preset: str = "object", model: Encoder | None = None) -> ObjectMethod:
    """Build a method by its registry name; ``model`` replaces the encoder that ships for ``preset``.

    Raises SettingsError on an unknown name, ModelError when the model is not fitted.
    """
    if name not in OBJECT_METHODS:
        raise SettingsError(f"method: expected one of {', '.join(OBJECT_METHODS)}, got {name!r}")
    if model is not None and not model.fitted:
        raise ModelError(f"model {model.settings.name!r}: not fitted")
    return OBJECT_METHODS[name](name, load_shipped_encoder(preset) if model is None else model)


def make_object_methods(
    names: Sequence[str], preset: str = "object", model: Encoder | None = None
) -> list[ObjectMethod]:
    """Build several methods; those that use one encoder compare views once, and share what came out.

    Raises as ``make_object_method`` does.
    """
    from depthprint.objects.encoded_methods import EncodedMethod
    from depthprint.objects.geometry_checked import GeometryChecked, ViewAgreements

    encoder = load_shipped_encoder(preset) if model is None else model
    methods = [make_object_method(name, preset, encoder) for name in names]
    shared: dict[int, ObjectComparisons] = {}
    surfaces, agreements = SurfaceComparisons(), ViewAgreements()
    for method in methods:
        if isinstance(method, GeometryChecked):
            method.agreements = agreements
    proposers: list[ObjectMethod] = [
        method.proposer if isinstance(method, GeometryChecked) else method for method in methods
    ]
    for method in proposers:
        if isinstance(method, EncodedMethod):
            own = method.comparisons
            own.shared_surfaces = surfaces
            method.comparisons = shared.setdefault(id(own.encoder), own)
    _share_descriptors(proposers)
    return methods


def _share_descriptors(methods: Sequence[ObjectMethod]) -> None:
    """Let rows of kernel descriptors with the same options describe views and learn words once."""
    if not any(method.name.startswith("kdes-") for method in methods):
        return
    from depthprint.objects.linear_methods import KernelDescriptorViews, LinearSvmMethod

    shared: dict[tuple[object, ...], KernelDescriptorViews] = {}
    for method in methods:
        if isinstance(method, LinearSvmMethod) and isinstance(method.features, KernelDescriptorViews):
            views = method.features
            views.described = shared.setdefault(views.described.options, views).described
