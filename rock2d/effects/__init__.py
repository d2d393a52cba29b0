"""The catalogue of effects: every module of this folder that defines `EFFECT`.

An effect is one file: its parameters, how it changes the world, and, where the engines must know of it, its compiled
law (see `rock2d.effects.forces`). A file added here is found, given its columns and compiled into the engines.
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

    from rock2d.effects.effect import Effect


@cache
def catalogue() -> Mapping[str, Effect]:
    """Every effect by its name, in the order of the names. Raises ValueError if two effects share a name."""
    found: dict[str, Effect] = {}
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if re.search(r"^EFFECT\b", path.read_text(encoding="utf-8"), re.MULTILINE):
            effect = import_module(f"{__name__}.{path.stem}").EFFECT
            if effect.name in found:
                raise ValueError(f"two effects are named {effect.name}; one is in {path.name}")
            found[effect.name] = effect
    return MappingProxyType(dict(sorted(found.items())))
