"""The soil stiffens from release to release.

k_t does not change: in the paper's law it regularises sticking and is not a property of the soil. So the stiffnesses of
`zone_contrast` and `soil_compaction` differ only in where and when they change."""

from collections.abc import Sequence

import numpy as np

from rock2d.effects.changes import with_scaled_columns
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.laws.contact import K_L, K_UL
from rock2d.scene.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """k_l(n) = k_l (1 + rate m), k_ul(n) = k_ul (1 + rate m) (1 + excess m), m = (1 - exp(-saturation n)) / saturation:
    n is the number of earlier releases of the block; without saturation, m = n."""
    rate, excess, saturation = values
    order = np.asarray(world.order, float)
    acting = -np.expm1(-saturation * order) / saturation if saturation > 0.0 else order
    world = with_scaled_columns(world, (K_L, K_UL), 1.0 + rate * acting)
    world = with_scaled_columns(world, (K_UL,), np.maximum(1.0 + excess * acting, 0.05))
    world.contact[..., K_UL] = np.maximum(world.contact[..., K_UL], world.contact[..., K_L])
    return world


def remedy(fitted: FittedEffect) -> str:
    """Loosen the soil before every release."""
    return (
        f"The stiffness grows by {fitted.number('rate', 100)} % of its first value with the first release of the same "
        "block, and less with later ones. Loosen and level the soil before every release, and film the blocks in "
        "random order. To check, repeat the first release at the end of the series: it should rebound differently."
    )


EFFECT = Effect(
    name="soil_compaction",
    summary="the soil stiffens from release to release, as blows compact it",
    source="stiffness that grows with the number of blows towards that of the densest state",
    phase="impact",
    origin="ground",
    grows=True,
    parameters=(
        Parameter("rate", "1", 0.0, 0.0, 0.45, "growth of k_l and k_ul with the first release of the same block"),
        Parameter("excess", "1", 0.0, -0.03, 0.03, "growth of k_ul / k_l with the first release of the same block"),
        Parameter("saturation", "1", 0.0, 0.0, 0.45, "share by which each release slows the growth", optional=True),
    ),
    apply=apply,
    remedy=remedy,
)
