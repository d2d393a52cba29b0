"""What a designer reads off an ensemble of tracks: every module of this folder that defines `INDICATOR`.

An indicator is one file. A file added here is found; its table is written by `rock2d run` and is given by
`RunResult.to_pandas`.
"""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rock2d.runs.indicators.indicator import Indicator


@cache
def indicators() -> Mapping[str, Indicator]:
    """Every indicator by its name, in the order of the names. Raises ValueError if two share a name."""
    found: dict[str, Indicator] = {}
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if re.search(r"^INDICATOR\b", path.read_text(encoding="utf-8"), re.MULTILINE):
            indicator = import_module(f"{__name__}.{path.stem}").INDICATOR
            if indicator.name in found:
                raise ValueError(f"two indicators are named {indicator.name}; one is in {path.name}")
            found[indicator.name] = indicator
    return MappingProxyType(dict(sorted(found.items())))
