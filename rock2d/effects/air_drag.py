"""Quadratic drag in flight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rock2d.compiled import kernel
from rock2d.effects.changes import with_air
from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.blocks import Block
from rock2d.scene.world import World

AIR_DENSITY_KG_M3 = 1.2


@kernel
def flight(c, vx, vy, omega, mass, inertia):
    """a = -c |v| v / m in m/s², c in kg/m; for a body of frontal area A in air of density ρ, c = ½ C_d ρ A."""
    pull = c / mass * np.sqrt(vx * vx + vy * vy)
    return -pull * vx, -pull * vy, 0.0


def coefficient(block: Block, per_mass_1_m: float) -> float:
    """C_d = 2 c / (ρ A) of a block with this c / m, A that of a body as deep as its profile is high."""
    return per_mass_1_m * block.mass_kg / (0.5 * AIR_DENSITY_KG_M3 * np.pi / 4.0 * block.size_m**2)


def apply(world: World, values: Sequence[float]) -> World:
    return with_air(world, "drag_kg_m", values[0])


EFFECT = Effect(
    name="air_drag",
    summary="drag of the air, with the square of the velocity",
    source="Newton's drag; Hoerner (1965), Fluid-dynamic drag: C_d 0.5 of a ball, 1 to 2 of a cube",
    phase="flight",
    origin="flight",
    # a 22 g ball of 25 mm in air has 0.007 1/m, a boulder of 1 m 0.0002; light models of foam reach the upper end
    parameters=(
        Parameter(
            "drag_per_mass_1_m", "1/m", 0.0, 0.0, 0.6, "c / m: share of its speed lost per metre", length=-1
        ),
    ),
    apply=apply,
    columns=("drag_kg_m",),
    flight=flight,
)
