"""Motion leaves the plane at impacts."""

from collections.abc import Sequence

import numpy as np

from rock2d.compiled import kernel
from rock2d.effects.changes import with_column
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number


@kernel
def departure(angle, vx, vy, omega):
    """Velocities in the plane after an impact that turns the horizontal velocity by `angle` rad about the vertical: v_x
    becomes v_x cos(angle). The rest of the energy leaves the plane."""
    return vx * np.cos(angle), vy, omega


def apply(world: World, values: Sequence[float]) -> World:
    return with_column(world, "out_of_plane_rad", values[0])


def remedy(fitted: FittedEffect) -> str:
    """Film from above as well."""
    lost = 1 - np.cos(fitted.values["angle_rad"])
    return (
        "Film from above as well: the horizontal velocity should turn by about "
        f"{fitted.number('angle_rad', np.rad2deg(1))}° at an impact, which takes {number(100 * lost)} % of it out "
        "of the plane. Guide the blocks between two plates, use cylinders, or leave out releases that swerve."
    )


EFFECT = Effect(
    name="out_of_plane",
    summary="motion leaves the plane at impacts: the horizontal velocity turns away",
    source="lateral dispersion of rockfall, Azzoni & de Freitas (1995): 10 to 20° of the fall line",
    phase="impact",
    origin="impact law",
    parameters=(Parameter("angle_rad", "rad", 0.0, 0.0, 1.0, "turn of the horizontal velocity at each impact"),),
    apply=apply,
    remedy=remedy,
    columns=("out_of_plane_rad",),
    departure=departure,
)
