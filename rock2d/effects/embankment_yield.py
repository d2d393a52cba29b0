"""The embankment moves as a body while it is hit."""

from __future__ import annotations

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
    """1 / M in 1/kg of an embankment that slides on its base. In its frame the block is accelerated by F_x (1/m + 1/M);
    when the impact ends it keeps the velocity J_x / M that the horizontal impulse J_x gave it, and friction at its base
    stops it before the next. Its displacement meanwhile (J_x / M × milliseconds) is neglected."""
    return per_mass


def apply(world: World, values: Sequence[float]) -> World:
    zones = facet_zones(world.cross_section, embankment_facets(world.cross_section))
    return with_column(world, "recoil_1_kg", values[0] / mean_mass_kg(world), zones)


def remedy(fitted: FittedEffect) -> str:
    """The mass ratio gives the mass that moves."""
    moving = mean_mass_kg(fitted.setup) / max(fitted.values["mass_ratio"], 1e-9)
    return (
        f"Look whether the embankment slides: film a mark on its crest. A moving mass of {number(moving)} kg is "
        "expected. Fix the embankment to its base and film again, or weigh it and state that it moves."
    )


EFFECT = Effect(
    name="embankment_yield",
    summary="the embankment slides on its base as a body while it is hit",
    source="two bodies in impact: head-on, e is (e M - m) / (M + m) of a block of mass m",
    phase="impact",
    origin="ground",
    parameters=(
        Parameter(
            "mass_ratio", "1", 0.0, 0.0, 0.6, "blocks' mean mass over the mass of the embankment that moves"
        ),
    ),
    apply=apply,
    remedy=remedy,
    columns=("recoil_1_kg",),
    recoil=recoil,
)
