"""Rate-dependent normal force in contact."""

from collections.abc import Sequence

from rock2d.compiled import kernel
from rock2d.effects.changes import mean_mass_kg, with_column
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number


@kernel
def normal(c, h, depth, rate, peak, bottom, force_n):
    """F = (c + h δ) dδ/dt in N while the ground presses, c in N s/m, h in N s/m², from the first touch on. The
    total force is not negative."""
    return (c + h * depth) * rate if depth >= bottom else 0.0


def damping(c, h):
    """Derivative of the force by the speed in N s/m, at a penetration of 10 mm."""
    return c + 0.01 * h


def apply(world: World, values: Sequence[float]) -> World:
    size = world.fitted_size_m
    mass = mean_mass_kg(world)
    world = with_column(world, "viscous_Ns_m", values[0] * mass)
    return with_column(world, "viscous_Ns_m2", values[1] * mass / size)


def remedy(fitted: FittedEffect) -> str:
    """Compare light and heavy blocks, which the same dashpots brake less."""
    constant = fitted.values["rate_1_s"] * mean_mass_kg(fitted.setup)
    deep = fitted.values["deep_rate_1_s"] * mean_mass_kg(fitted.setup) / fitted.setup.mean_size_m
    return (
        "Drop a light and a heavy block of one shape vertically on the flat soil, from several heights: the lighter "
        "one should rebound less. If so, add a dashpot parallel to the normal spring: F = (c + h δ) dδ/dt with c = "
        f"{number(constant)} N s/m and h = {number(deep)} N s/m²."
    )


EFFECT = Effect(
    name="viscous_damping",
    summary="rate-dependent normal force while the ground presses on the block",
    source="dashpot parallel to the spring: Cundall & Strack (1979), A discrete model for granular assemblies; one "
    "that grows with the depth: Hunt & Crossley (1975), Coefficient of restitution interpreted as damping in "
    "vibroimpact",
    phase="impact",
    origin="impact law",
    # critical is 2 √(k_l / m): 1,300 1/s for the paper's blocks, if they penetrate by a tenth of their size
    parameters=(
        Parameter("rate_1_s", "1/s", 0.0, 0.0, 900.0, "dashpot over the blocks' mean mass", time=-1),
        Parameter(
            "deep_rate_1_s",
            "1/s",
            0.0,
            0.0,
            9000.0,
            "growth of the dashpot down to a depth of one block size, over the mean mass",
            time=-1,
        ),
    ),
    apply=apply,
    remedy=remedy,
    columns=("viscous_Ns_m", "viscous_Ns_m2"),
    normal=normal,
    damping=damping,
)
