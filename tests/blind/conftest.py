"""Blind cases that are small enough for tests."""

from functools import partial

import pytest

from rock2d.blind import case_files
from rock2d.blind.cases import draw_case


@pytest.fixture
def small(monkeypatch):
    """Cases of ten releases."""
    monkeypatch.setattr(case_files, "draw_case", partial(draw_case, smallest=True))
