"""Motion out of the plane: each impact takes a share of the horizontal speed, random or constant."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"share": (0.3, 0.45)[form] * share, "random": float(form == 0)}


CAUSE = Cause(sizes, forms=2, switches=(parameters.SPEED_LOSS,), draw_order=15)
