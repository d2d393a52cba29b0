"""The recorded orientation has a constant offset."""

from collections.abc import Sequence

import numpy as np

from rock2d.effects.changes import with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number, plain


def apply(world: World, values: Sequence[float]) -> World:
    """θ recorded = θ true + offset."""
    return with_view(world, theta_offset_rad=world.view.theta_offset_rad + values[0])


def remedy(fitted: FittedEffect) -> str:
    """Correct the angles."""
    value, half = fitted.values["offset_rad"], fitted.half["offset_rad"]
    degrees, width = np.rad2deg([value, half])
    way = "counter-clockwise" if value > 0 else "clockwise"
    return (
        f"Add {plain(-value, half)} to every `theta_rad` ({number(-degrees, width)}°) and diagnose again. The "
        f"tracked angle lies {number(abs(degrees), width)}° {way} of the block's own x axis. If it comes from "
        "two marks, choose marks on a line along that axis."
    )


EFFECT = Effect(
    name="angle_offset",
    summary="the recorded orientation has a constant offset: corners meet the ground elsewhere than they seem to",
    source="the tracker's zero of the angle, `rock2d.scene.world.View`",
    phase="impact",
    origin="camera",
    parameters=(Parameter("offset_rad", "rad", 0.0, -0.4, 0.4, "recorded less true angle, counter-clockwise"),),
    apply=apply,
    remedy=remedy,
)
