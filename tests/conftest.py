"""Fixtures that several tests share, and one thread of linear algebra for all of them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Matrices are small: a second thread only waits for the first, at twenty times the processor time. The workers of
# pytest and the commands that tests start have it, too. Before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder that holds `data/` and `practice/`; tests that need real data are skipped without it."""
    root = os.environ.get("ROCK2D_DATA")
    if not root:
        pytest.skip("ROCK2D_DATA does not point to the folder that holds data/ and practice/")
    return Path(root)
