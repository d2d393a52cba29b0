"""Fixtures of the tests of tracking."""

from __future__ import annotations

import pytest


@pytest.fixture
def put(tmp_path):
    def write(text: str, name: str = "seen.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write
