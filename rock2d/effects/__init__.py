"""The catalogue of effects: what the modules of this folder define as `EFFECT`, or as `EFFECTS` by origin.

An effect has parameters, a change of the world, and, if the engines need it, a compiled law (see
`rock2d.effects.forces`). A new one is found, gets its columns, and is compiled into the engines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rock2d.registry import registered

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rock2d.effects.effect import Effect


def catalogue() -> Mapping[str, Effect]:
    """Name -> effect, in alphabetical order. Raises ValueError if two effects share a name."""
    return registered(__name__, "EFFECT")
