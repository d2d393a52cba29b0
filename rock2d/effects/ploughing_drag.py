"""The block ploughs: tangential resistance that grows with depth and speed."""

from collections.abc import Sequence

from rock2d.compiled import kernel
from rock2d.effects.changes import mean_mass_kg, with_column
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number


@kernel
def tangential(c, depth, slip, force_n):
    """F = c δ u in N against the slip u of the contact point, c in N s/m², while the ground presses."""
    return c * depth * slip if force_n > 0.0 else 0.0


def damping(c):
    """Derivative of the force by the speed in N s/m, at a penetration of 10 mm."""
    return 0.01 * c


def apply(world: World, values: Sequence[float]) -> World:
    size = world.fitted_size_m
    return with_column(world, "ploughing_Ns_m2", values[0] * mean_mass_kg(world) / size)


def remedy(fitted: FittedEffect) -> str:
    """Measure the grooves, or add the drag to the contact law."""
    drag = fitted.values["rate_1_s"] * mean_mass_kg(fitted.setup) / fitted.setup.mean_size_m
    return (
        "Measure depth and length of the grooves: deep, fast ones should brake the block more than friction does. "
        f"Then add a tangential force F = c δ u against the slip u, with c = {number(drag)} N s/m² and the "
        "depth δ. Shallow throws at two speeds separate it from friction, which does not grow with the speed."
    )


EFFECT = Effect(
    name="ploughing_drag",
    summary="the block ploughs: tangential resistance that grows with depth and speed",
    source="drag of the ploughed front, proportional to its area and to the speed",
    phase="impact",
    origin="impact law",
    parameters=(
        Parameter(
            "rate_1_s",
            "1/s",
            0.0,
            0.0,
            6000.0,
            "drag over slip, at a depth of one block size, over the mean mass",
            time=-1,
        ),
    ),
    apply=apply,
    remedy=remedy,
    columns=("ploughing_Ns_m2",),
    tangential=tangential,
    damping=damping,
)
