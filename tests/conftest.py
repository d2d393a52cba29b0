"""Fixtures that several tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder that holds `data/` and `practice/`; tests that need real data are skipped without it."""
    root = os.environ.get("ROCK2D_DATA")
    if not root:
        pytest.skip("ROCK2D_DATA does not point to the folder that holds data/ and practice/")
    return Path(root)
