"""The cascade detector: vectors propose, the exact NCD ranks, geometry verifies, neighbouring frames second."""

from __future__ import annotations

from functools import partial

from depthprint.cascade.fused_recognizer import FusedRecognizer
from depthprint.cascade.settings import CascadeSettings
from depthprint.cascade.verified_recognizer import VerifiedRecognizer
from depthprint.encoder import Encoder
from depthprint.presets import is_planar
from depthprint.recognizer import PlaceRecognizer
from depthprint.settings import EncoderSettings
from depthprint.verification.verifier import GeometricVerifier
from depthprint.verification.view_cache import ViewCache

__all__ = ["make_cascade", "places_checked", "places_correlated"]

_FRAMES_THAT_SECOND = 3
# Of forward and spinning sensors more give no more loops. Hand-held ones have as many from the columns as from the
# codes; planar scans too, and what correlates best comes first.
_CHECKED, _CHECKED_IN_PERSPECTIVE, _CHECKED_PLANAR = 4, 10, 5


def make_cascade(
    encoder: Encoder,
    settings: CascadeSettings | None = None,
    *,
    verifier: GeometricVerifier | None = None,
    views: ViewCache | None = None,
) -> PlaceRecognizer:
    """Build the detector over a fitted encoder, with the stages that ``settings`` turn on.

    ``views`` is shared by methods that see the same frames. Raises MissingExtraError, on its first query, when
    hand-held views are to be verified without small_gicp.
    """
    settings = CascadeSettings() if settings is None else settings
    inner: PlaceRecognizer
    further = None
    if settings.vectors:
        fused = inner = FusedRecognizer(encoder, settings)
        if settings.turned:
            further = partial(fused.turned, k=settings.turned)
    else:
        from depthprint.complexity_recognizer import ComplexityRecognizer

        inner = ComplexityRecognizer(encoder, relaxed=settings.relaxed and not settings.exact)
    if not settings.verify:
        return inner
    checked = places_checked(encoder.settings) if settings.verified is None else settings.verified
    correlated = places_correlated(encoder.settings, settings)
    polar = encoder.settings.polar
    shifts = any(stream.view == "polar" for stream in encoder.settings.streams)
    return VerifiedRecognizer(
        inner,
        checked,
        spread=settings.spread,
        pool=max(settings.ranked, checked, correlated) if settings.vectors else None,
        correlated=correlated,
        columns_full_circle=polar.sectors if polar.full_circle and shifts else None,
        climb=settings.climb,
        consistency=_FRAMES_THAT_SECOND if settings.consistency else 0,
        track=settings.track,
        heading=settings.heading,
        further=further,
        verifier=verifier,
        views=views,
    )


def places_checked(settings: EncoderSettings) -> int:
    """How many proposals geometry looks at, by the sensor that the settings are made for: ours and a rival's alike."""
    if is_planar(settings):
        return _CHECKED_PLANAR
    in_perspective = all(stream.view != "polar" for stream in settings.streams)
    return _CHECKED_IN_PERSPECTIVE if in_perspective else _CHECKED


def places_correlated(settings: EncoderSettings, stages: CascadeSettings) -> int:
    """How many proposals are ordered by how well scans correlate: ours and a rival's alike, of planar scans alone."""
    return stages.correlated if is_planar(settings) else 0
