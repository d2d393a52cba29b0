"""Metres per pixel are off."""

from __future__ import annotations

from collections.abc import Sequence

from rock2d.effects.changes import CENTRE, with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """(x, y) recorded = c + scale ((x, y) - c), c the point that the camera aims at."""
    return with_view(world, values[1:], scale=world.view.scale * values[0])


EFFECT = Effect(
    name="scale_error",
    summary="metres per pixel are off: lengths and speeds, gravity among them, all come out too large or too small",
    source="similarity of the image, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(Parameter("scale", "1", 1.0, 0.85, 1.15, "recorded length over true length"), *CENTRE),
    apply=apply,
)
