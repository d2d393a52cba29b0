"""Force across the velocity, proportional to the spin."""

from collections.abc import Sequence

from rock2d.compiled import kernel
from rock2d.effects.changes import with_air
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number


@kernel
def flight(c, vx, vy, omega, mass, inertia):
    """a = (c/m) ω × v in m/s², c in kg; ω × v = ω (-vy, vx). It does no work: with constant ω and no weight the path is
    a circle with the angular velocity c ω / m. A ball in an ideal fluid has c = (8/3) π ρ r³."""
    turn = c / mass * omega
    return -turn * vy, turn * vx, 0.0


def apply(world: World, values: Sequence[float]) -> World:
    return with_air(world, "lift_kg", values[0])


def remedy(fitted: FittedEffect) -> str:
    """Film forward spin and backspin."""
    value, half = fitted.values["lift_per_mass"], fitted.half["lift_per_mass"]
    way = "counter-clockwise" if value > 0 else "clockwise"
    return (
        f"The path of a block with counter-clockwise spin turns {way}, at {number(abs(value), half)} times the "
        "spin. Film the same throw with forward spin and with backspin: the paths must bend to opposite sides. If "
        "they do not, look for wind."
    )


EFFECT = Effect(
    name="magnus_lift",
    summary="force of the air across the velocity, proportional to the spin",
    source="Magnus effect; Rubinow & Keller (1961), Kutta & Joukowski; positive lifts a block with backspin",
    phase="flight",
    origin="flight",
    # physical for a 22 g ball of 25 mm: 0.0009; a boulder: 0.001
    parameters=(Parameter("lift_per_mass", "1", 0.0, -0.03, 0.03, "c / m: turning rate of the path over the spin"),),
    apply=apply,
    remedy=remedy,
    columns=("lift_kg",),
    flight=flight,
)
