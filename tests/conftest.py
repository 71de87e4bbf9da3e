"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Development data: DEPTHPRINT_DATA, else ../shared/data beside the checkout; skips where absent."""
    named = os.environ.get("DEPTHPRINT_DATA")
    folder = Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"development data not found at {folder} (set DEPTHPRINT_DATA)")
    return folder
