"""Indicators: tables that are computed from the tracks of a run. Every module of this folder that defines `INDICATOR`.

To add an indicator, add a file: `rock2d run` writes its table, and `RunResult.to_pandas` returns it."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from rock2d.registry import registered

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rock2d.runs.indicators.indicator import Indicator


@cache
def indicators() -> Mapping[str, Indicator]:
    """Every indicator by its name, in the order of the names. Raises ValueError if two share a name."""
    return registered(__name__, __file__, "INDICATOR")
