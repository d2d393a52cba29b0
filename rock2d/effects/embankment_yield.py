"""The embankment moves as a body during an impact."""

from collections.abc import Sequence

from rock2d.compiled import kernel
from rock2d.effects.changes import mean_mass_kg, with_column
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.cross_section import embankment_facets, facet_zones
from rock2d.scene.world import World
from rock2d.wording import number


@kernel
def recoil(per_mass):
    """1 / M in 1/kg of an embankment of mass M that slides on its base. In its frame the block is accelerated by
    F_x (1/m + 1/M). After the impact the embankment has the velocity J_x / M from the horizontal impulse J_x, and
    friction at its base stops it before the next impact. Its displacement (J_x / M × milliseconds) is neglected."""
    return per_mass


def apply(world: World, values: Sequence[float]) -> World:
    zones = facet_zones(world.cross_section, embankment_facets(world.cross_section))
    return with_column(world, "recoil_1_kg", values[0] / mean_mass_kg(world), zones)


def remedy(fitted: FittedEffect) -> str:
    """Check whether the embankment slides, with the mass that moves."""
    moving = mean_mass_kg(fitted.setup) / max(fitted.values["mass_ratio"], 1e-9)
    return (
        f"Look whether the embankment slides: film a mark on its crest. A moving mass of {number(moving)} kg is "
        "expected. Fix the embankment to its base and film again, or weigh it and state that it moves."
    )


EFFECT = Effect(
    name="embankment_yield",
    summary="the embankment slides on its base as a body during an impact",
    source="two bodies in impact: head-on, e is (e M - m) / (M + m) of a block of mass m",
    phase="impact",
    origin="ground",
    parameters=(
        Parameter("mass_ratio", "1", 0.0, 0.0, 0.6, "blocks' mean mass over the mass of the embankment that moves"),
    ),
    apply=apply,
    remedy=remedy,
    columns=("recoil_1_kg",),
    recoil=recoil,
)
