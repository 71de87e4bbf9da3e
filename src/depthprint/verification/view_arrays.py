"""A depth view as named arrays, for a place database, and back again bit for bit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError
from depthprint.projection import LaserRow, Pinhole, Spherical
from depthprint.verification.depth_view import DepthView
from depthprint.verification.settings import VerificationSettings

__all__ = ["pack_view", "unpack_view"]

_PROJECTIONS = {kind.__name__: kind for kind in (Pinhole, Spherical, LaserRow)}


def pack_view(view: DepthView) -> dict[str, npt.NDArray[Any]]:
    """``view_ranges_m`` (h, w) and ``view_counted`` (m, 3) float32, ``view_facts`` the bytes of JSON: all the rest."""
    facts = {
        "kind": type(view.projection).__name__,
        "projection": asdict(view.projection),
        "settings": asdict(view.settings),
    }
    return {
        "view_ranges_m": view.ranges_m,
        "view_counted": view.counted,
        "view_facts": np.frombuffer(json.dumps(facts).encode(), dtype=np.uint8),
    }


def unpack_view(arrays: Mapping[str, npt.NDArray[Any]]) -> DepthView:
    """The view that ``pack_view`` took apart; DataError where an array is missing or says something else."""
    try:
        facts = json.loads(arrays["view_facts"].tobytes())
        settings: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in facts["settings"].items()
        }
        return DepthView(
            arrays["view_ranges_m"],
            _PROJECTIONS[facts["kind"]](**facts["projection"]),
            arrays["view_counted"],
            VerificationSettings(**settings),
        )
    except (KeyError, ValueError, TypeError, AttributeError, SettingsError) as error:
        raise DataError(f"depth view: expected the arrays of pack_view, got {error!r}") from error
