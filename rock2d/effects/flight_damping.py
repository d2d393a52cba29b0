"""Drag linear in velocity, for translation and rotation."""

from collections.abc import Sequence

from rock2d.compiled import kernel
from rock2d.effects.changes import with_air
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World


@kernel
def flight(c, vx, vy, omega, mass, inertia):
    """a = -(c/m) v in m/s², α = -(c/m) ω in rad/s²: velocity and spin both decay as exp(-c t / m), c in kg/s."""
    rate = c / mass
    return -rate * vx, -rate * vy, -rate * omega


def apply(world: World, values: Sequence[float]) -> World:
    return with_air(world, "damping_kg_s", values[0])


def remedy(fitted: FittedEffect) -> str:
    """Look for numerical damping, or film a spinning block."""
    return (
        f"Velocity and spin decay by {fitted.number('rate_1_s', 100)} % a second in flight. If the film was "
        "simulated, switch off the global damping of that program. If not, film a spinning block in a long flight: "
        "only this effect slows the spin, too."
    )


EFFECT = Effect(
    name="flight_damping",
    summary="drag linear in velocity, for translation and rotation",
    source="Stokes's drag; the global damping of many discrete-element codes has the same form",
    phase="flight",
    origin="flight",
    parameters=(Parameter("rate_1_s", "1/s", 0.0, 0.0, 2.0, "share of velocity and spin lost per second", time=-1),),
    apply=apply,
    remedy=remedy,
    columns=("damping_kg_s",),
    flight=flight,
)
