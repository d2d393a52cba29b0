"""The recorded orientation has a constant offset."""

from __future__ import annotations

from collections.abc import Sequence

from rock2d.effects.changes import with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """θ recorded = θ true + offset."""
    return with_view(world, theta_offset_rad=world.view.theta_offset_rad + values[0])


EFFECT = Effect(
    name="angle_offset",
    summary="the recorded orientation has a constant offset: corners meet the ground elsewhere than they seem to",
    source="the tracker's zero of the angle, `rock2d.scene.world.View`",
    phase="impact",
    origin="camera",
    parameters=(
        Parameter("offset_rad", "rad", 0.0, -0.4, 0.4, "recorded less true angle, counter-clockwise"),
    ),
    apply=apply,
)
