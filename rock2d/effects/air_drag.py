"""Quadratic drag in flight."""

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
def flight(c, vx, vy, omega, mass, inertia):
    """a = -c |v| v / m in m/s², c in kg/m; for a body of frontal area A in air of density ρ, c = ½ C_d ρ A."""
    pull = c / mass * np.sqrt(vx * vx + vy * vy)
    return -pull * vx, -pull * vy, 0.0


def coefficient(block: Block, per_mass_1_m: float) -> float:
    """Drag coefficient C_d = 2 c / (ρ A) of a block with this c / m in 1/m; A is the area of a circle with its size as
    diameter."""
    return per_mass_1_m * block.mass_kg / (0.5 * AIR_DENSITY_KG_M3 * np.pi / 4.0 * block.size_m**2)


def apply(world: World, values: Sequence[float]) -> World:
    return with_air(world, "drag_kg_m", values[0])


def remedy(fitted: FittedEffect) -> str:
    """Compare the drag coefficient with usual values."""
    value = fitted.values["drag_per_mass_1_m"]
    blocks, by_block = fitted.setup.blocks, fitted.by_block.get("drag_per_mass_1_m", {})
    drag = {name: number(coefficient(block, value)) for name, block in blocks.items()}
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


EFFECT = Effect(
    name="air_drag",
    summary="drag of the air, with the square of the velocity",
    source="Newton's drag; Hoerner (1965), Fluid-dynamic drag: C_d 0.5 of a ball, 1 to 2 of a cube",
    phase="flight",
    origin="flight",
    # a 22 g ball of 25 mm in air has 0.007 1/m, a boulder of 1 m 0.0002; light models of foam reach the upper end
    parameters=(
        Parameter("drag_per_mass_1_m", "1/m", 0.0, 0.0, 0.6, "c / m: share of its speed lost per metre", length=-1),
    ),
    apply=apply,
    remedy=remedy,
    columns=("drag_kg_m",),
    flight=flight,
)
