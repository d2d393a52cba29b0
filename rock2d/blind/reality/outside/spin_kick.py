"""At lift-off the block gains speed off the ground in proportion to its spin."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"kick": 0.3 * share}


CAUSE = Cause(sizes, columns={"kick": parameters.SPIN_KICK}, draw_order=8)
