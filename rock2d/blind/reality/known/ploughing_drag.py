"""Ploughing: a resistance proportional to depth × slip, or to depth × slip²."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import IMPACT_SPEED, Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    linear = 6.0 * share * scale.spring * scale.mass / scale.size
    speed = IMPACT_SPEED * scale.speed
    return {"linear": linear, "square": 0.0} if form == 0 else {"linear": 0.0, "square": 1.5 * linear / speed}


CAUSE = Cause(
    sizes, forms=2, columns={"linear": parameters.PLOUGHING, "square": parameters.PLOUGHING_SQUARE}, draw_order=13
)
