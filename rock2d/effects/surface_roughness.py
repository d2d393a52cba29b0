"""The local slope varies from impact to impact, or from place to place."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number


def apply(world: World, values: Sequence[float]) -> World:
    """The normal of the ground turns by β from impact to impact, β normally distributed with mean 0 and standard
    deviation `sd_rad`. `values[0]` is one β for all releases, or one for each."""
    return replace(world, slope_rad=np.atleast_1d(np.asarray(values[0], float)))


def remedy(fitted: FittedEffect) -> str:
    """Survey and level the surface."""
    slope = np.rad2deg(fitted.values["sd_rad"])
    return (
        "Survey the surface at distances of a block's size: a standard deviation of the slope of "
        f"{number(slope)}° is expected. If a profile of the ground was learnt, the surface is the same in every "
        "release: compare the curve with the survey. Else there is no mean to correct: level the surface before every "
        "release, or count the scatter as part of the soil and film more releases."
    )


EFFECT = Effect(
    name="surface_roughness",
    summary="the local slope varies from impact to impact, or from place to place",
    source="random slope of the impact surface, as in Pfeiffer & Bowen (1989), Computer simulation of rockfalls",
    phase="impact",
    origin="ground",
    parameters=(Parameter("sd_rad", "rad", 0.0, 0.0, 0.3, "standard deviation of the local slope"),),
    apply=apply,
    remedy=remedy,
    scatter=True,
)
