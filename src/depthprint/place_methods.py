"""The registry of methods that recognise places: ours, its ablations and the baselines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from depthprint.encoder import Encoder
from depthprint.encoder_file import shipped_model_path
from depthprint.errors import ModelError, SettingsError
from depthprint.presets import preset_settings
from depthprint.recognizer import PlaceRecognizer
from depthprint.settings import PolarSettings

if TYPE_CHECKING:
    from depthprint.verification.view_cache import ViewCache

__all__ = [
    "PLACE_METHODS",
    "WITH_GEOMETRY",
    "PlaceMethodContext",
    "load_shipped_encoder",
    "make_place_recognizer",
]

WITH_GEOMETRY = "+geometry"

# A narrow hand-held view reaches a few metres: the bird's-eye grid of the baseline is scaled to it.
_HANDHELD_POLAR = PolarSettings(sectors=24, rings=20, ring_m=0.25, ground_clearance_m=0.2, max_height_m=3.0)
_HANDHELD_CHANNELS = ("height", "low-count", "high-count")


@dataclass(frozen=True)
class PlaceMethodContext:
    """What a method may be built from: the preset of the data where given, a trained model and a shared view."""

    preset: str
    model: Encoder | None = None
    views: ViewCache | None = None

    def encoder(self) -> Encoder:
        """The given model, or the one that ships for the preset."""
        return self.model if self.model is not None else load_shipped_encoder(self.preset)

    def polar(self) -> tuple[PolarSettings, tuple[str, ...], int]:
        """Bird's-eye grid, channels and largest shift that suit the data."""
        settings = preset_settings(self.preset)
        channels = tuple(c for s in settings.streams if s.view == "polar" for c in s.channels)
        if not channels:
            return _HANDHELD_POLAR, _HANDHELD_CHANNELS, 3
        return settings.polar, channels, settings.max_shift


def load_shipped_encoder(preset: str) -> Encoder:
    """The encoder, trained on simulated worlds, that ships for a preset."""
    return Encoder.load(shipped_model_path(preset))


def _emd(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.complexity_recognizer import ComplexityRecognizer

    return ComplexityRecognizer(context.encoder())


def _emd_relaxed(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.complexity_recognizer import ComplexityRecognizer

    return ComplexityRecognizer(context.encoder(), relaxed=True)


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


def _compression(compressor: str) -> Callable[[PlaceMethodContext], PlaceRecognizer]:
    def make(context: PlaceMethodContext) -> PlaceRecognizer:
        from depthprint.baselines.compression import CompressionRecognizer

        return CompressionRecognizer(compressor)

    return make


def _detector(context: PlaceMethodContext) -> PlaceRecognizer:
    from depthprint.cascade import make_cascade

    return make_cascade(context.encoder(), views=context.views)


PLACE_METHODS: dict[str, Callable[[PlaceMethodContext], PlaceRecognizer]] = {
    "emd": _emd,
    "emd-literal": _emd_literal,
    "emd-relaxed": _emd_relaxed,
    "detector": _detector,
    "cosine": _cosine,
    "pixel-l2": _pixel_l2,
    "pixel-l2-centred": _pixel_l2_centred,
    "scan-context-like": _scan_context_like,
    "scan-context-like-channels": _scan_context_like_channels,
    "ncd-gzip": _compression("gzip"),
    "ncd-bz2": _compression("bz2"),
    "ncd-ppm": _compression("ppm"),
    "ncd-lzma": _compression("lzma"),
    "ncd-zstd": _compression("zstd"),
}


def make_place_recognizer(
    name: str, preset: str, model: Encoder | None = None, views: ViewCache | None = None
) -> PlaceRecognizer:
    """Build a method by its registry name, for data that suits ``preset``.

    NAME+geometry is a method whose best few proposals are checked by geometry. ``model`` replaces the shipped encoder
    of the methods that use the preset's. ``views`` lets methods that see the same frames share what the check needs.
    Raises SettingsError on an unknown name, ModelError when the model is not fitted.
    """
    plain = name.removesuffix(WITH_GEOMETRY)
    if plain not in PLACE_METHODS:
        raise SettingsError(
            f"method: expected one of {', '.join(PLACE_METHODS)}, or one of them with {WITH_GEOMETRY}, got {name!r}"
        )
    if model is not None and not model.fitted:
        raise ModelError(f"model {model.settings.name!r}: not fitted")
    context = PlaceMethodContext(preset, model, views)
    recognizer = PLACE_METHODS[plain](context)
    if plain == name:
        return recognizer
    from depthprint.verified_recognizer import VerifiedRecognizer

    polar = context.polar()[0]
    columns = polar.sectors if polar.full_circle else None
    return VerifiedRecognizer(recognizer, columns_full_circle=columns, views=views)
