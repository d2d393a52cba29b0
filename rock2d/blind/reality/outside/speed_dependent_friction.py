"""Friction falls with the normal speed at which a contact begins."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    # at share 1 as measured on squares of 2 cm: impulse ratio 0.15 at 0.7 m/s, 0.066 at 2.3 m/s
    return {"fall_s_m": share / (1.26 * scale.speed)}


CAUSE = Cause(sizes, columns={"fall_s_m": parameters.FRICTION_FALL})
