"""Blind cases that are small enough for tests."""

from functools import partial

import pytest

from rock2d.blind import case_files, signal_to_noise
from rock2d.blind.cases import draw_case


@pytest.fixture
def small(monkeypatch):
    """Cases of ten releases, whose signals, for which nobody asks, are fitted in two steps."""
    monkeypatch.setattr(case_files, "draw_case", partial(draw_case, smallest=True))
    monkeypatch.setattr(signal_to_noise, "MOST_LAW_STEPS", 2)
