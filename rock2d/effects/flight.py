"""Effects in flight: drag, damping and lift."""

from collections.abc import Sequence

import numpy as np

from rock2d.compiled import kernel
from rock2d.effects.changes import with_air
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.blocks import Block
from rock2d.scene.world import World
from rock2d.wording import interval, number, spoken

AIR_DENSITY_KG_M3 = 1.2


@kernel
def drag_acceleration(c, vx, vy, omega, mass, inertia):
    """a = -c |v| v / m in m/s², c in kg/m; for a body of frontal area A in air of density ρ, c = ½ C_d ρ A."""
    pull = c / mass * np.sqrt(vx * vx + vy * vy)
    return -pull * vx, -pull * vy, 0.0


def drag_coefficient(block: Block, per_mass_1_m: float) -> float:
    """Drag coefficient C_d = 2 c / (ρ A) of a block with this c / m in 1/m; A is the area of a circle with its size as
    diameter."""
    return per_mass_1_m * block.mass_kg / (0.5 * AIR_DENSITY_KG_M3 * np.pi / 4.0 * block.size_m**2)


def with_air_drag(world: World, values: Sequence[float]) -> World:
    return with_air(world, "drag_kg_m", values[0])


def air_drag_remedy(fitted: FittedEffect) -> str:
    """Compare the drag coefficient with usual values."""
    value = fitted.values["drag_per_mass_1_m"]
    blocks, by_block = fitted.setup.blocks, fitted.by_block.get("drag_per_mass_1_m", {})
    drag = {name: number(drag_coefficient(block, value)) for name, block in blocks.items()}
    comparison = ""
    if by_block:
        coefficients = {name: own["drag_coefficient"] for name, own in by_block.items()}
        drag = {b: f"{number(c['value'])} ({interval(*c['ci95'])})" for b, c in coefficients.items()}
        low, high = np.array([c["ci95"] for c in coefficients.values()]).T
        comparison = " (significantly different)" if low.max() > high.min() else ""
    listed = ", ".join(f"{spoken(name)} {c}" for name, c in drag.items())
    return (
        f"Blocks lose {fitted.number('drag_per_mass_1_m', 100)} % of their speed on a metre of flight. In air this is "
        f"a drag coefficient of {listed}{comparison}; 0.5 for a ball and 1 to 2 for a body with edges are usual. If "
        "the value is usual, the model lacks the drag of the air. If it is larger, look for what else brakes: a wire, "
        "dust, wind. Film a long free fall, and a heavier block of the same shape, which air slows less."
    )


AIR_DRAG = Effect(
    name="air_drag",
    summary="drag of the air, with the square of the velocity",
    source="Newton's drag; Hoerner (1965), Fluid-dynamic drag: C_d 0.5 of a ball, 1 to 2 of a cube",
    phase="flight",
    origin="flight",
    # a 22 g ball of 25 mm in air has 0.007 1/m, a boulder of 1 m 0.0002; light models of foam reach the upper end
    parameters=(
        Parameter("drag_per_mass_1_m", "1/m", 0.0, 0.0, 0.6, "c / m: share of its speed lost per metre", length=-1),
    ),
    apply=with_air_drag,
    remedy=air_drag_remedy,
    columns=("drag_kg_m",),
    flight=drag_acceleration,
)


@kernel
def damping_acceleration(c, vx, vy, omega, mass, inertia):
    """a = -(c/m) v in m/s², α = -(c/m) ω in rad/s²: velocity and spin both decay as exp(-c t / m), c in kg/s."""
    rate = c / mass
    return -rate * vx, -rate * vy, -rate * omega


def with_flight_damping(world: World, values: Sequence[float]) -> World:
    return with_air(world, "damping_kg_s", values[0])


def flight_damping_remedy(fitted: FittedEffect) -> str:
    """Look for numerical damping, or film a spinning block."""
    return (
        f"Velocity and spin decay by {fitted.number('rate_1_s', 100)} % a second in flight. If the film was "
        "simulated, switch off the global damping of that program. If not, film a spinning block in a long flight: "
        "only this effect slows the spin, too."
    )


FLIGHT_DAMPING = Effect(
    name="flight_damping",
    summary="drag linear in velocity, for translation and rotation",
    source="Stokes's drag; the global damping of many discrete-element codes has the same form",
    phase="flight",
    origin="flight",
    parameters=(Parameter("rate_1_s", "1/s", 0.0, 0.0, 2.0, "share of velocity and spin lost per second", time=-1),),
    apply=with_flight_damping,
    remedy=flight_damping_remedy,
    columns=("damping_kg_s",),
    flight=damping_acceleration,
)


@kernel
def lift_acceleration(c, vx, vy, omega, mass, inertia):
    """a = (c/m) ω × v in m/s², c in kg; ω × v = ω (-vy, vx). It does no work: with constant ω and no weight the path is
    a circle with the angular velocity c ω / m. A ball in an ideal fluid has c = (8/3) π ρ r³."""
    turn = c / mass * omega
    return -turn * vy, turn * vx, 0.0


def with_magnus_lift(world: World, values: Sequence[float]) -> World:
    return with_air(world, "lift_kg", values[0])


def magnus_lift_remedy(fitted: FittedEffect) -> str:
    """Film forward spin and backspin."""
    value, half = fitted.values["lift_per_mass"], fitted.half["lift_per_mass"]
    way = "counter-clockwise" if value > 0 else "clockwise"
    return (
        f"The path of a block with counter-clockwise spin turns {way}, at {number(abs(value), half)} times the "
        "spin. Film the same throw with forward spin and with backspin: the paths must bend to opposite sides. If "
        "they do not, look for wind."
    )


MAGNUS_LIFT = Effect(
    name="magnus_lift",
    summary="force of the air across the velocity, proportional to the spin",
    source="Magnus effect; Rubinow & Keller (1961), Kutta & Joukowski; positive lifts a block with backspin",
    phase="flight",
    origin="flight",
    # physical for a 22 g ball of 25 mm: 0.0009; a boulder: 0.001
    parameters=(Parameter("lift_per_mass", "1", 0.0, -0.03, 0.03, "c / m: turning rate of the path over the spin"),),
    apply=with_magnus_lift,
    remedy=magnus_lift_remedy,
    columns=("lift_kg",),
    flight=lift_acceleration,
)


EFFECTS = (AIR_DRAG, FLIGHT_DAMPING, MAGNUS_LIFT)
