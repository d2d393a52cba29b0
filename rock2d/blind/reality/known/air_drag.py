"""Air drag: quadratic in the speed, or with the power 1.7."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import IMPACT_SPEED, Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    power = (2.0, 1.7)[form]
    per_length = 0.012 / scale.size
    return {"drag": share * per_length * (IMPACT_SPEED * scale.speed) ** (2.0 - power), "power": power}


CAUSE = Cause(sizes, forms=2, columns={"drag": parameters.DRAG, "power": parameters.DRAG_POWER}, draw_order=0)
