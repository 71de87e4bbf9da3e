"""Presets: the combinations of view, atoms and clusters that suit a sensor and a use."""

from __future__ import annotations

from depthprint.errors import SettingsError
from depthprint.settings import EncoderSettings, PolarSettings, StreamSettings

__all__ = ["PRESETS", "bird_eye_columns", "is_planar", "preset_settings"]

# A narrow hand-held view reaches a few metres: its bird's-eye grid is scaled to it.
_HAND_HELD_POLAR = PolarSettings(sectors=24, rings=20, ring_m=0.25, ground_clearance_m=0.2, max_height_m=3.0)
_HAND_HELD_CHANNELS = ("height", "low-count", "high-count")
_HAND_HELD_SHIFT = 3


def _literal() -> EncoderSettings:
    """Table 1 as printed: 256 whole-image atoms of 96 x 96 raw depth, 20 of them a model."""
    stream = StreamSettings(
        view="raw-depth",
        atoms="image",
        n_nonzero=20,
        clusters="atoms",
        point_dims=0,
        position_weight=0.0,
        form="joint",
    )
    return EncoderSettings(name="literal", streams=(stream,))


def _object() -> EncoderSettings:
    common = {
        "patch_shape": (8, 8), "stride": 2, "n_nonzero": 4, "clusters": "cells", "cells": (4, 3), "root": True,
        "position_weight": 3.0, "depth_weight": 3.0, "masses": "balanced",
    }  # fmt: skip
    pairs = {
        "view": "pairs", "patch_shape": (0, 1), "stride": 1, "n_nonzero": 8, "clusters": "patches",
        "position_weight": 6.0, "masses": "balanced", "weight": 3.0,
    }  # fmt: skip
    return EncoderSettings.parse(
        {
            "name": "object",
            "streams": (
                {"view": "normals", **common},
                {"view": "depth", "weight": 0.5, **common},
                {"channels": ("metres",), **pairs},
                {"channels": ("sizes",), **pairs},
            ),
            "mirror": True,
        }
    )


def _handheld() -> EncoderSettings:
    common = {
        "patch_shape": (8, 8), "stride": 2, "n_nonzero": 4, "clusters": "cells", "cells": (6,),
        "position_weight": 3.0, "depth_weight": 3.0, "form": "steinhaus",
    }  # fmt: skip
    return EncoderSettings.parse(
        {
            "name": "handheld",
            "streams": ({"view": "normals", **common}, {"view": "depth", "weight": 0.5, **common}),
            "view_shift_steps": (1, 1),
        }
    )


def _street() -> EncoderSettings:
    columns = {
        "view": "polar", "patch_shape": (0, 4), "stride": 1, "n_nonzero": 10, "clusters": "patches", "point_dims": 20,
        "mass": "unit", "position_weight": 0.25,
    }  # fmt: skip
    return EncoderSettings.parse(
        {
            "name": "street",
            "streams": (
                {"channels": ("height",), **columns},
                {"channels": ("low-count", "high-count"), **columns},
            ),
            "polar": PolarSettings(ring_m=3.0),
            "max_shift": 3,
        }
    )


def _lidar() -> EncoderSettings:
    columns = {
        "view": "polar", "patch_shape": (0, 4), "stride": 2, "n_nonzero": 10, "clusters": "patches", "point_dims": 20,
        "mass": "unit", "position_weight": 1.0,
    }  # fmt: skip
    return EncoderSettings.parse(
        {
            "name": "lidar",
            "streams": (
                {"channels": ("height",), **columns},
                {"channels": ("low-count", "high-count"), **columns},
            ),
            "polar": PolarSettings(sectors=60, full_circle=True),
        }
    )


def _laser() -> EncoderSettings:
    stream = {
        "view": "polar", "channels": ("count", "line-cos", "line-sin"), "patch_shape": (0, 4), "stride": 1,
        "n_nonzero": 20, "clusters": "patches", "point_dims": 100, "mass": "unit", "position_weight": 1.0,
    }  # fmt: skip
    return EncoderSettings.parse({"name": "laser", "streams": (stream,), "max_shift": 6})


PRESETS = {
    settings.name: settings
    for settings in (_literal(), _object(), _street(), _handheld(), _lidar(), _laser())
}


def preset_settings(name: str) -> EncoderSettings:
    """Settings of a preset; an unknown name raises SettingsError listing those there are."""
    try:
        return PRESETS[name]
    except KeyError:
        raise SettingsError(f"preset: expected one of {', '.join(PRESETS)}, got {name!r}") from None


def bird_eye_columns(settings: EncoderSettings) -> tuple[PolarSettings, tuple[str, ...], int]:
    """Bird's-eye grid, channels and largest shift in sectors that suit the sensor of some settings."""
    channels = tuple(c for stream in settings.streams if stream.view == "polar" for c in stream.channels)
    if not channels:
        return _HAND_HELD_POLAR, _HAND_HELD_CHANNELS, _HAND_HELD_SHIFT
    return settings.polar, channels, settings.max_shift


def is_planar(settings: EncoderSettings) -> bool:
    """Whether some settings are made for planar scans: they count all returns, without bands of heights."""
    return any(s.view == "polar" and "count" in s.channels for s in settings.streams)
