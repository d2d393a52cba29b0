"""Eccentric mass: the centre of mass is displaced along the x axis of the block, or diagonally."""

from rock2d.blind.reality.cause import Cause, Rng, Scale, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    offset = 0.15 * share * scale.size * random_sign(rng)
    return {"x_m": offset, "y_m": 0.0} if form == 0 else {"x_m": 0.7 * offset, "y_m": 0.7 * random_sign(rng) * offset}


CAUSE = Cause(sizes, forms=2, draw_order=3)
