"""Adhesion: tension during unloading, constant, or fading with the rise."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    pull = (12.0, 18.0)[form] * share * scale.mass * scale.gravity
    return {"pull_N": pull, "fades": float(form), "onset_m_s": 0.05 * scale.speed}


CAUSE = Cause(
    sizes,
    forms=2,
    columns={"pull_N": parameters.TENSION, "fades": parameters.TENSION_FADES, "onset_m_s": parameters.TENSION_SPEED},
    draw_order=12,
)
