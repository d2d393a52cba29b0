"""Viscous damping: a dashpot parallel to the spring, or one that grows with the depth (Hunt and Crossley)."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import IMPACT_SPEED, Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    dashpot = 0.9 * share * scale.mass * scale.spring
    depth = IMPACT_SPEED * scale.speed / scale.spring
    return {"dashpot": dashpot, "hunt": 0.0} if form == 0 else {"dashpot": 0.0, "hunt": 1.6 * dashpot / depth}


CAUSE = Cause(sizes, forms=2, columns={"dashpot": parameters.DASHPOT, "hunt": parameters.DEPTH_DASHPOT}, draw_order=11)
