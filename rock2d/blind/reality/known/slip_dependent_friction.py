"""Friction that changes with the slip velocity, by an exponential or a hyperbola."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    change = 1.5 * share if rng.random() < 0.5 else -0.8 * share
    return {"change": change, "speed_m_s": 2.0 * scale.speed, "hyperbolic": float(form)}


CAUSE = Cause(
    sizes,
    forms=2,
    columns={
        "change": parameters.SLIP_CHANGE,
        "speed_m_s": parameters.SLIP_SPEED,
        "hyperbolic": parameters.SLIP_HYPERBOLIC,
    },
    draw_order=14,
)
