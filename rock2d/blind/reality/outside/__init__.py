"""Causes outside the catalogue of effects, one file each."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rock2d.blind.reality.cause import Cause, causes_in


@cache
def outside_causes() -> dict[str, Cause]:
    """Every outside cause by name, in draw order."""
    return causes_in(__name__, Path(__file__).parent)
