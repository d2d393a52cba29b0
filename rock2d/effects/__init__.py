"""The catalogue of effects: every module of this folder that defines `EFFECT`.

An effect is one file: its parameters, how it changes the world, and, where the engines must know of it, its compiled
law (see `rock2d.effects.forces`). A file added here is found, given its columns and compiled into the engines.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from rock2d.registry import registered

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rock2d.effects.effect import Effect


@cache
def catalogue() -> Mapping[str, Effect]:
    """Every effect by its name, in the order of the names. Raises ValueError if two effects share a name."""
    return registered(__name__, __file__, "EFFECT")
