"""The true frame rate differs from the stated one."""

from __future__ import annotations

from collections.abc import Sequence

from rock2d.effects.changes import with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """t recorded = t true / time_scale."""
    return with_view(world, time_scale=world.view.time_scale * values[0])


EFFECT = Effect(
    name="frame_rate_error",
    summary="the true frame rate differs from the stated one: gravity goes with its square, contact times with it",
    source="the camera's clock, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter(
            "time_scale", "1", 1.0, 0.85, 1.15, "true duration over recorded one: stated over true rate"
        ),
    ),
    apply=apply,
)
