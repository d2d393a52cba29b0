"""The image axes are turned against the vertical."""

from __future__ import annotations

from collections.abc import Sequence

from rock2d.effects.changes import CENTRE, with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """(x, y) recorded = c + R(tilt) ((x, y) - c), θ recorded = θ + tilt: R turns counter-clockwise, c is the
    point that the camera aims at."""
    return with_view(world, values[1:], tilt_rad=world.view.tilt_rad + values[0])


EFFECT = Effect(
    name="camera_tilt",
    summary="the image axes are turned against the vertical: gravity seems to have a part along the image's x",
    source="rigid rotation of the image, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter("tilt_rad", "rad", 0.0, -0.15, 0.15, "by how much the record is turned, counter-clockwise"),
        *CENTRE,
    ),
    apply=apply,
)
