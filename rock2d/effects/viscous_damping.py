"""Rate-dependent dissipation across the ground, in contact."""

from __future__ import annotations

from collections.abc import Sequence

from rock2d.compiled import kernel
from rock2d.effects.changes import mean_mass_kg, with_column
from rock2d.effects.effect import Effect, Parameter
from rock2d.world import World


@kernel
def normal(c, depth, rate, peak, bottom, force_n):
    """F = c dδ/dt in N while the ground presses, c in N s/m, from the first touch on; the whole force never pulls."""
    return c * rate if depth >= bottom else 0.0


def damping(c):
    """The dashpot itself is what limits the step."""
    return c


def apply(world: World, values: Sequence[float]) -> World:
    return with_column(world, "viscous_Ns_m", values[0] * mean_mass_kg(world))


EFFECT = Effect(
    name="viscous_damping",
    summary="rate-dependent dissipation across the ground while it presses",
    source="linear dashpot beside the spring: Cundall & Strack (1979), A discrete model for granular assemblies",
    phase="impact",
    # critical is 2 √(k_l / m): 1,300 1/s for the paper's blocks and soil
    parameters=(
        Parameter("rate_1_s", "1/s", 0.0, 0.0, 600.0, "dashpot over the blocks' mean mass", time=-1),
    ),
    apply=apply,
    columns=("viscous_Ns_m",),
    normal=normal,
    damping=damping,
)
