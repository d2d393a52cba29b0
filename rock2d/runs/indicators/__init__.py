"""What a designer reads off an ensemble of tracks: every module of this folder that defines `INDICATOR`.

An indicator is one file. A file added here is found; its table is written by `rock2d run` and is given by
`RunResult.to_pandas`.
"""

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
