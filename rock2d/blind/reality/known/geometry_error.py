"""Wrong geometry: the facing is turned about its foot, or the ditch is raised."""

from rock2d.blind.reality.cause import Cause, Rng, Scale, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"turn_rad": 0.2 * share * random_sign(rng)} if form == 0 else {"rise": 0.15 * share * random_sign(rng)}


CAUSE = Cause(sizes, forms=2, draw_order=6)
