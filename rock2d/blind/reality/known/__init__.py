"""The known effects in the reality engine, one file each, in forms that differ from those of the toolkit."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rock2d.blind.reality.cause import Cause, causes_in


@cache
def known_causes() -> dict[str, Cause]:
    """Every known effect by name, in draw order."""
    return causes_in(__name__, Path(__file__).parent)
