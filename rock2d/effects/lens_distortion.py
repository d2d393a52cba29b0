"""Radial distortion of the image, about the point that the camera aims at: see `rock2d.effects.changes.image`."""

from __future__ import annotations

from collections.abc import Sequence

from rock2d.effects.changes import CENTRE, image, with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """d recorded = d (1 + k |d|²) with d = (x, y) - c, k = edge / W²: c is the point that the camera aims at, W the
    width of embankment and ditch."""
    return with_view(
        world, values[1:], lens_per_m2=world.view.lens_per_m2 + values[0] / image(world.cross_section)[1] ** 2
    )


EFFECT = Effect(
    name="lens_distortion",
    summary="radial distortion of the image: what lies off its middle is recorded too far out, or in",
    source="first term of D. C. Brown (1971), Close-range camera calibration: r (1 + k r²), `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter(
            "edge",
            "1",
            0.0,
            -0.05,
            0.05,
            "k W²: displacement over distance at the width W of embankment and ditch from the image's middle",
        ),
        *CENTRE,
    ),
    apply=apply,
)
