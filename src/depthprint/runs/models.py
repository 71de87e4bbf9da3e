"""Which trained model a run uses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from depthprint.errors import ModelError

if TYPE_CHECKING:
    from depthprint.encoder import Encoder

__all__ = ["choose_model", "require_model"]


def choose_model(model: Path | None, preset: str | None, suited: str) -> tuple[str, Encoder | None]:
    """Settle the preset, and load the model where one is given.

    suited: the preset that suits the data, taken when neither ``model`` nor ``preset`` says otherwise. The encoder is
    None when the shipped one is meant. Raises ModelError when a model was trained with another preset than asked for,
    SettingsError for an unknown preset.
    """
    from depthprint.presets import preset_settings

    if model is None:
        name = preset or suited
        preset_settings(name)
        return name, None
    from depthprint.encoder import Encoder

    if preset is not None:
        preset_settings(preset)
    encoder = Encoder.load(model)
    trained = encoder.settings.name
    if preset is not None and preset != trained:
        raise ModelError(f"{model}: expected a model of preset {preset!r}, found one of {trained!r}")
    return trained, encoder


def require_model(model: Path | None, preset: str | None, suited: str) -> Encoder:
    """Load the given model, or the shipped one of the preset."""
    name, encoder = choose_model(model, preset, suited)
    if encoder is not None:
        return encoder
    from depthprint.encoder import load_shipped_encoder

    return load_shipped_encoder(name)
