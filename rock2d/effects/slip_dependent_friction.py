"""Friction that changes with the sliding speed."""

from collections.abc import Sequence

import numpy as np

from rock2d.compiled import kernel
from rock2d.effects.changes import with_column
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number

LEAST_RATIO = 0.05  # smallest tan φ (u) / tan φ (0)


@kernel
def friction(change, speed, slip):
    """tan φ (u) / tan φ (0) = 1 + change (1 - exp(-|u| / speed)), u the slip in m/s."""
    return max(LEAST_RATIO, 1.0 + change * (1.0 - np.exp(-abs(slip) / speed)))


def apply(world: World, values: Sequence[float]) -> World:
    change, speed = values
    if change == 0.0:
        return world
    return with_column(with_column(world, "friction_change", change), "friction_speed_m_s", speed)


def remedy(fitted: FittedEffect) -> str:
    """Measure the friction angle at low and at high speed."""
    change, speed = fitted.values["change"], fitted.values["speed_m_s"]
    rest = float(fitted.law["friction_angle_deg"])
    fast = np.rad2deg(np.arctan(np.tan(np.deg2rad(rest)) * max(LEAST_RATIO, 1.0 + change)))
    return (
        f"Drag a block over the soil at speeds well below and above {number(speed)} m/s: the friction angle "
        f"should {'grow' if change > 0 else 'fall'} from {number(rest)}° to {number(float(fast))}°. If it "
        "does, make the friction of the contact law depend on the sliding speed."
    )


EFFECT = Effect(
    name="slip_dependent_friction",
    summary="friction changes with the sliding speed, from its value at rest to another one",
    source="exponential (Stribeck) law, Bo & Pavelescu (1982), The friction-speed relation",
    phase="impact",
    origin="impact law",
    parameters=(
        Parameter("change", "1", 0.0, -0.9, 2.0, "relative change of tan φ at high sliding speed"),
        Parameter(
            "speed_m_s",
            "m/s",
            1.0,
            0.2,
            5.0,
            "sliding speed at which most of the change has occurred",
            length=1,
            time=-1,
        ),
    ),
    apply=apply,
    remedy=remedy,
    columns=("friction_change", "friction_speed_m_s"),
    friction=friction,
)
