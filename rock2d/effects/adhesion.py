"""Wet soil pulls on the leaving block."""

from collections.abc import Sequence

from rock2d.compiled import kernel
from rock2d.effects.changes import mean_mass_kg, with_column
from rock2d.effects.effect import STANDARD_GRAVITY_M_S2, Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World

ONSET_M_S = 0.02  # leaving speed up to which the pull grows: a sudden pull would make a block at rest vibrate
ONSET_SHARE = 0.1  # share of the path out of the indentation over which the pull grows


@kernel
def normal(pull, depth, rate, peak, bottom, force_n):
    """F = -pull in N on a block that leaves (dδ/dt < 0), from the bottom of the indentation, where the ground stops
    pressing, to the original surface. The pull grows linearly with the distance and with the leaving speed. A block
    that leaves faster than ONSET_M_S loses the energy pull × bottom × (1 - ONSET_SHARE / 2)."""
    if rate >= 0.0 or depth >= bottom or bottom <= 0.0:
        return 0.0
    return -pull * min(1.0, -rate / ONSET_M_S) * min(1.0, (bottom - depth) / (ONSET_SHARE * bottom))


def damping(pull):
    """Largest derivative of the force by the speed in N s/m: at the onset."""
    return abs(pull) / ONSET_M_S


def apply(world: World, values: Sequence[float]) -> World:
    return with_column(world, "adhesion_N", values[0] * mean_mass_kg(world) * STANDARD_GRAVITY_M_S2)


def remedy(fitted: FittedEffect) -> str:
    """Measure the pull in N."""
    pull = fitted.number("pull_per_weight", mean_mass_kg(fitted.setup) * STANDARD_GRAVITY_M_S2)
    return (
        "Press a block into the soil and lift it with a spring balance: in addition to its weight a pull of "
        f"{pull} N is expected. Dry the soil or clean the blocks and film again, or add "
        "the pull to the contact law while the block leaves."
    )


EFFECT = Effect(
    name="adhesion",
    summary="wet soil pulls on a leaving block until the block is clear of the ground",
    source="constant tension along the path out of the indentation, the simplest law with a work of separation",
    phase="impact",
    origin="impact law",
    parameters=(Parameter("pull_per_weight", "1", 0.0, 0.0, 12.0, "pull divided by the blocks' mean weight"),),
    apply=apply,
    remedy=remedy,
    columns=("adhesion_N",),
    normal=normal,
    damping=damping,
)
