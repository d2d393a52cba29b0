"""Motion leaves the plane at impacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rock2d.compiled import kernel
from rock2d.effects.changes import with_column
from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.world import World


@kernel
def departure(angle, vx, vy, omega):
    """What an impact leaves in the plane: the horizontal velocity turns by `angle` rad about the vertical, so that v_x
    becomes v_x cos(angle); the rest is energy that the plane loses."""
    return vx * np.cos(angle), vy, omega


def apply(world: World, values: Sequence[float]) -> World:
    return with_column(world, "out_of_plane_rad", values[0])


EFFECT = Effect(
    name="out_of_plane",
    summary="motion leaves the plane at impacts: the horizontal velocity turns away",
    source="lateral dispersion of rockfall, Azzoni & de Freitas (1995): 10 to 20° of the fall line",
    phase="impact",
    origin="impact law",
    parameters=(
        Parameter("angle_rad", "rad", 0.0, 0.0, 1.0, "turn of the horizontal velocity at each impact"),
    ),
    apply=apply,
    columns=("out_of_plane_rad",),
    departure=departure,
)
