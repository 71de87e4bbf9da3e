"""The registry of methods that recognise places: ours, its ablations and the baselines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from depthprint.encoder import Encoder, load_shipped_encoder
from depthprint.encoder_ablations import random_patches, without_coding
from depthprint.errors import ModelError, SettingsError
from depthprint.presets import bird_eye_columns, preset_settings
from depthprint.range_image import RangeImage
from depthprint.recognizer import PlaceRecognizer
from depthprint.settings import PolarSettings

if TYPE_CHECKING:
    from depthprint.verification.view_cache import ViewCache

__all__ = [
    "PLACE_METHODS",
    "WITH_GEOMETRY",
    "PlaceMethodContext",
    "make_place_recognizer",
]

WITH_GEOMETRY = "+geometry"

# The papers' settings for spinning LiDARs; for narrower views what did best on simulated development data that is
# scored nowhere: a drive along KITTI 05 by stereo and by laser, and rooms.
_NARROW = {"sectors": 24, "full_circle": False, "max_shift": 6, "candidates": None}
_SCAN_CONTEXT: dict[str, dict[str, Any]] = {
    "street": {**_NARROW, "reach_m": 60.0},
    "lidar": {},
    "laser": {**_NARROW, "reach_m": 60.0, "value": "count"},
    "handheld": {"sectors": 24, "reach_m": 5.0, "full_circle": False, "max_shift": 3},
}
_M2DP: dict[str, dict[str, Any]] = {"laser": {"reach_m": 40.0}}
_LONG_UNCENTRED = {"frames": 20, "centred": False}
_SEQSLAM: dict[str, dict[str, Any]] = dict.fromkeys(("street", "laser", "handheld"), _LONG_UNCENTRED)
_MAP_CLOSURES: dict[str, dict[str, Any]] = {"handheld": {"resolution_m": 0.01}}


@dataclass(frozen=True)
class PlaceMethodContext:
    """What a method may be built from: the preset of the data and, where given, a trained model, and more.

    views: depth views shared by methods that see the same frames. learn_from: frames of another recording, for methods
    whose vocabulary is not part of ``model``.
    """

    preset: str
    model: Encoder | None = None
    views: ViewCache | None = None
    learn_from: Sequence[RangeImage] | None = None

    def encoder(self, ablated: Callable[[Encoder], Encoder] | None = None) -> Encoder:
        """The given model, or the one that ships for the preset; ``ablated`` takes a part from it."""
        whole = self.model if self.model is not None else load_shipped_encoder(self.preset)
        return whole if ablated is None else ablated(whole)

    def polar(self) -> tuple[PolarSettings, tuple[str, ...], int]:
        """Bird's-eye grid, channels and largest shift that suit the data."""
        return bird_eye_columns(preset_settings(self.preset))


def _emd_with(
    *, ablated: Callable[[Encoder], Encoder] | None = None, relaxed: bool = False
) -> Callable[[PlaceMethodContext], PlaceRecognizer]:
    """The information distance alone, or its lower bound, over the encoder or an ablated one."""

    def make(context: PlaceMethodContext) -> PlaceRecognizer:
        from depthprint.complexity_recognizer import ComplexityRecognizer

        return ComplexityRecognizer(context.encoder(ablated), relaxed=relaxed)

    return make


def _emd_literal(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.complexity_recognizer import ComplexityRecognizer

    return ComplexityRecognizer(load_shipped_encoder("literal"))


def _cosine(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.baselines.cosine import CosineRecognizer

    return CosineRecognizer(context.encoder())


def _pixel_l2(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.baselines.pixel_l2 import PixelL2Recognizer

    return PixelL2Recognizer()


def _pixel_l2_centred(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.baselines.pixel_l2 import PixelL2Recognizer

    return PixelL2Recognizer(centred=True)


def _scan_context_like(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.baselines.scan_context_like import ScanContextLikeRecognizer

    polar, channels, max_shift = context.polar()
    return ScanContextLikeRecognizer(polar, channels[:1], max_shift)


def _scan_context_like_channels(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.baselines.scan_context_like import ScanContextLikeRecognizer

    return ScanContextLikeRecognizer(*context.polar())


def _scan_context(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.baselines.scan_context import ScanContextRecognizer

    return ScanContextRecognizer(**_SCAN_CONTEXT.get(context.preset, _SCAN_CONTEXT["street"]))


def _m2dp(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.baselines.m2dp import M2dpRecognizer

    return M2dpRecognizer(**_M2DP.get(context.preset, {}))


def _seqslam(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.baselines.seqslam import SeqSlamRecognizer

    return SeqSlamRecognizer(**_SEQSLAM.get(context.preset, {}))


def _fabmap2(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.baselines.fabmap.model_file import load_fabmap, shipped_fabmap_path
    from depthprint.baselines.fabmap.recognizer import FabMapRecognizer

    shipped = FabMapRecognizer(*load_fabmap(shipped_fabmap_path(context.preset)))
    return shipped if context.learn_from is None else shipped.fit(context.learn_from)


def _map_closures(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.baselines.map_closures import MapClosuresRecognizer

    return MapClosuresRecognizer(**_MAP_CLOSURES.get(context.preset, {}))


def _compression(compressor: str) -> Callable[[PlaceMethodContext], PlaceRecognizer]:
    def make(context: PlaceMethodContext) -> PlaceRecognizer:
        from depthprint.baselines.compression import CompressionRecognizer

        return CompressionRecognizer(compressor)

    return make


def _detector_with(
    *, ablated: Callable[[Encoder], Encoder] | None = None, **stages: Any
) -> Callable[[PlaceMethodContext], PlaceRecognizer]:
    """The detector with some settings of its cascade, or over another encoder."""

    def make(context: PlaceMethodContext) -> PlaceRecognizer:
        from depthprint.cascade.assembly import make_cascade
        from depthprint.cascade.settings import CascadeSettings

        return make_cascade(context.encoder(ablated), CascadeSettings(**stages), views=context.views)

    return make


PLACE_METHODS: dict[str, Callable[[PlaceMethodContext], PlaceRecognizer]] = {
    "emd": _emd_with(),
    "emd-literal": _emd_literal,
    "emd-relaxed": _emd_with(relaxed=True),
    "emd-no-coding": _emd_with(ablated=without_coding),
    "emd-random-patches": _emd_with(ablated=random_patches),
    "fused": _detector_with(verify=False),
    "detector": _detector_with(),
    "detector-no-vectors": _detector_with(vectors=False),
    "detector-no-relaxed": _detector_with(relaxed=False),
    "detector-no-exact": _detector_with(exact=False),
    "detector-no-thumbnails": _detector_with(thumbnail_weight=0.0),
    "detector-no-columns": _detector_with(columns=False),
    "detector-no-turned": _detector_with(turned=0),
    "detector-no-correlation": _detector_with(correlated=0),
    "detector-no-climb": _detector_with(climb=False),
    "detector-no-track": _detector_with(track=False),
    "detector-no-heading": _detector_with(heading=False),
    "detector-no-history": _detector_with(track=False, consistency=False),
    "detector-no-coding": _detector_with(ablated=without_coding),
    "detector-random-patches": _detector_with(ablated=random_patches),
    "cosine": _cosine,
    "pixel-l2": _pixel_l2,
    "pixel-l2-centred": _pixel_l2_centred,
    "scan-context-like": _scan_context_like,
    "scan-context-like-channels": _scan_context_like_channels,
    "scan-context": _scan_context,
    "m2dp": _m2dp,
    "seqslam": _seqslam,
    "fabmap2": _fabmap2,
    "map-closures": _map_closures,
    "ncd-gzip": _compression("gzip"),
    "ncd-bz2": _compression("bz2"),
    "ncd-ppm": _compression("ppm"),
    "ncd-lzma": _compression("lzma"),
    "ncd-zstd": _compression("zstd"),
}


def make_place_recognizer(
    name: str,
    preset: str,
    model: Encoder | None = None,
    views: ViewCache | None = None,
    learn_from: Sequence[RangeImage] | None = None,
) -> PlaceRecognizer:
    """Build a method by its registry name, for data that suits ``preset``.

    NAME+geometry is a method whose best proposals, as many as the detector's, are checked by geometry. ``model``
    replaces the shipped encoder of the methods that use the preset's, and what ``fabmap2`` learns from the frames
    ``learn_from``, which must not be scored, its shipped vocabulary. ``views`` lets methods that see the same frames
    share what the check needs.
    Raises SettingsError on an unknown name, ModelError when the model is not fitted.
    """
    plain = name.removesuffix(WITH_GEOMETRY)
    if plain not in PLACE_METHODS:
        raise SettingsError(
            f"method: expected one of {', '.join(PLACE_METHODS)}, or one of them with {WITH_GEOMETRY}, got {name!r}"
        )
    if model is not None and not model.fitted:
        raise ModelError(f"model {model.settings.name!r}: not fitted")
    context = PlaceMethodContext(preset, model, views, learn_from)
    recognizer = PLACE_METHODS[plain](context)
    if plain == name:
        return recognizer
    from depthprint.cascade.assembly import places_checked, places_correlated
    from depthprint.cascade.settings import CascadeSettings
    from depthprint.cascade.verified_recognizer import VerifiedRecognizer

    polar, settings = context.polar()[0], preset_settings(preset)
    return VerifiedRecognizer(
        recognizer,
        places_checked(settings),
        correlated=places_correlated(settings, CascadeSettings()),
        columns_full_circle=polar.sectors if polar.full_circle else None,
        track=True,
        views=views,
    )
